"""Units of angles as people write them in the names of columns, variables and files.

A number is an angle in a unit only if a word says so: a unit that is no unit of angle is named, never ignored.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

AngleUnit: TypeAlias = Literal["deg", "mdeg", "rad", "mrad", "urad", "gon", "arcmin", "arcsec", "turn"]
"""Unit of an angle in a recording."""

DEG_PER: dict[AngleUnit, float] = {
    "deg": 1.0,
    "mdeg": 1e-3,
    "rad": math.degrees(1.0),
    "mrad": math.degrees(1e-3),
    "urad": math.degrees(1e-6),
    "gon": 0.9,
    "arcmin": 1 / 60,
    "arcsec": 1 / 3600,
    "turn": 360.0,
}
"""Degrees of one unit."""

_WORDS_OF: dict[AngleUnit, str] = {
    "deg": "deg degs degree degrees °",
    "mdeg": "mdeg millideg millidegree millidegrees m°",
    "rad": "rad rads radian radians",
    "mrad": "mrad millirad milliradian milliradians",
    "urad": "urad µrad microrad microradian microradians",
    "gon": "gon gons gradian gradians",
    "arcmin": "arcmin arcmins arcminute arcminutes ' ′",
    "arcsec": 'arcsec arcsecs arcsecond arcseconds " ″',
    "turn": "turn turns rev revs revolution revolutions",
}
UNIT_OF_WORD: dict[str, AngleUnit] = {
    unicodedata.normalize("NFKC", word): unit for unit, words in _WORDS_OF.items() for word in words.split()
}
"""Unit of each word for one; a micro sign is written as the Greek letter."""

DEGREES = frozenset(_WORDS_OF["deg"].split())
"""Words for degrees."""

ANGLE_WORDS = frozenset({"angle", "angles", "ang", "winkel", "theta", "phi", "rotation", "rot", "roll"})
"""Words that say that a number is an angle."""

_OTHER_UNITS = frozenset(
    {
        *("count", "counts", "cts", "step", "steps", "microstep", "microsteps", "usteps", "tick", "ticks", "pulse"),
        *("pulses", "increment", "increments", "inkremente", "schritt", "schritte", "encoder", "lsb", "adc", "px"),
        *("pixel", "pixels", "index", "frame", "frames", "nr", "grad", "grads", "mil", "mils", "hz", "khz"),
        *("nm", "um", "μm", "mm", "cm", "inch", "ns", "us", "μs", "ms", "sec", "min", "mv", "μv", "volt", "volts"),
    }
)
"""Words of what is counted or measured in another unit than one of angle; ``grad`` is degrees to some, gon to others.
"""

_LETTER_UNITS = frozenset({"m", "s", "v"})
"""Units of one letter, which count as such only at the end of a name without a word for an angle."""

_UNITS = _OTHER_UNITS | _LETTER_UNITS | set(UNIT_OF_WORD)

_BRACKETED = re.compile(r"\[([^\]]*)\]|\(([^)]*)\)")
_WORD = re.compile(r"[^\W\d_]*°|[^\W\d_]+")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_JOINED = re.compile(rf"({'|'.join(sorted(ANGLE_WORDS, key=len, reverse=True))})([a-zµμ]+)")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedUnit:
    """What a name says of the unit of its numbers."""

    unit: AngleUnit | None
    """Unit of angle; None if the name has none, or another unit."""
    other: str = ""
    """Text of a unit that is no unit of angle, or of two units; empty if the name has none."""
    is_angle: bool = False
    """Whether a word or a unit says that the numbers are angles."""


def unit_in(name: str) -> NamedUnit:
    """Return what the name of a column or variable says: ``angle_mrad``, ``Winkel [gon]``, ``encoder_counts``."""
    words = _words(name)
    is_angle = not ANGLE_WORDS.isdisjoint(words)
    for square, round_ in _BRACKETED.findall(name):
        content = (square or round_).strip()
        unit = _bracketed_unit(content)
        others = [each for each in _units(_words(_BRACKETED.sub(" ", name))) if each != unit]
        if unit is not None and others:
            return NamedUnit(unit=None, other=" and ".join([*others, unit]), is_angle=True)
        if unit is not None:
            return NamedUnit(unit=unit, is_angle=True)
        # Round brackets also hold remarks, such as "angle (measured)".
        if square.strip() or not _UNITS.isdisjoint(_words(content)):
            return NamedUnit(unit=None, other=content, is_angle=is_angle)
    units = _units(words)
    if len(units) == 1:
        return NamedUnit(unit=units[0], is_angle=True)
    if units:
        return NamedUnit(unit=None, other=" and ".join(units), is_angle=is_angle)
    other = next((word for word in reversed(words) if word in _OTHER_UNITS), "")
    if not other and not is_angle and words and words[-1] in _LETTER_UNITS:
        other = words[-1]
    return NamedUnit(unit=None, other=other, is_angle=is_angle)


def _units(words: Sequence[str]) -> list[AngleUnit]:
    return list(dict.fromkeys(UNIT_OF_WORD[word] for word in words if word in UNIT_OF_WORD))


def _bracketed_unit(content: str) -> AngleUnit | None:
    """Return the unit that a text in brackets is, or holds beside a remark; None for one of parts, such as 0.1 deg."""
    plain = unicodedata.normalize("NFKC", content).strip(" .").lower()
    if plain in UNIT_OF_WORD:
        return UNIT_OF_WORD[plain]
    words = _words(plain)
    units = _units(words)
    parts = re.search(r"[\d/*·]", plain) or not (_OTHER_UNITS | _LETTER_UNITS).isdisjoint(words)
    return units[0] if len(units) == 1 and not parts else None


def _words(name: str) -> list[str]:
    """Return the words of a name in small letters: ``angleDeg``, ``angle_deg`` and ``angledeg`` are angle and deg."""
    found: list[str] = []
    for word in _WORD.findall(unicodedata.normalize("NFKC", name)):
        # "mRad" is one word, "angleRad" two.
        parts = [word] if word.lower() in UNIT_OF_WORD else _CAMEL.split(word)
        for part in (each.lower() for each in parts):
            joined = _JOINED.fullmatch(part)
            found += joined.groups() if joined and joined[2] in UNIT_OF_WORD else (part,)
    return found
