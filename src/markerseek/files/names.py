"""Names of files and groups: their natural order, and the angles in them; and the folder of the user's own files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

from markerseek.core import RecordError
from markerseek.files.angle_units import ANGLE_WORDS, DEG_PER, UNIT_OF_WORD

# A hyphen behind a letter or digit separates: img-2 is 2, and 2024-05-03 is a date.
_NUMBER = re.compile(r"(?:(?<![a-z0-9.)])-)?\d+(?:\.\d+)*", re.ASCII | re.IGNORECASE)
_ANGLE = re.compile(
    r"(?P<word>[a-z_ ]*)(?P<angle>(?<![a-z])[-+](?:\d+(?:\.\d+)?|\.\d+)|\d+(?:\.\d+)?|\.\d+)"
    r"(?:[_ ]?(?P<unit>degrees|degree|deg|°|mdeg|mrad|rad|gon))?",
    re.ASCII | re.IGNORECASE,
)
# "neg_12.5" or "m12.5" would be read as +12.5: the sign of an angle is never guessed.
_SIGN_WORDS = re.compile(r"(?:^|[_ ])(?:m|n|p)$|(?:neg|negative|minus|pos|positive|plus)$")

NaturalKey: TypeAlias = tuple[tuple[str | tuple[Decimal, ...], ...], str]
"""Texts and numbers of a name in turn, and the name itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedAngle:
    """The angle in a name."""

    angle_deg: float
    word: str
    """The word before it, in small letters; empty if there is none."""
    stated: bool
    """Whether a sign, a decimal point, a unit or the word says that the number is an angle and does not count."""


def natural(name: str) -> NaturalKey:
    """Return the key that sorts names by the numbers in them: frame2 before frame10, and -10.0 before 2.5."""
    parts: list[str | tuple[Decimal, ...]] = []
    end = 0
    for match in _NUMBER.finditer(name):
        numbers = match[0].split(".")
        # One point is a decimal one; several part the numbers of a UID or a version.
        parts += [
            name[end : match.start()].casefold(),
            (Decimal(match[0]),) if len(numbers) == 2 else tuple(map(Decimal, numbers)),
        ]
        end = match.end()
    return (*parts, name[end:].casefold()), name


def in_natural_order(paths: Iterable[Path]) -> list[Path]:
    """Return the paths sorted by their last names, as `natural` sorts."""
    return sorted(paths, key=lambda path: natural(path.name))


def endings(paths: Iterable[Path]) -> str:
    """Return the endings of the names of files, for messages: ".gif, .webp"; "no files" if there are none."""
    found = sorted({path.suffix.lower() or "no ending" for path in paths if not path.name.startswith(".")})
    return ", ".join(found) or "no files"


def angle_in(name: str) -> NamedAngle | None:
    """Return the angle in degrees in a name without suffix, such as ``-12.5`` or ``angle_-12.5deg``; None: in doubt."""
    match = _ANGLE.fullmatch(name)
    word = match["word"].strip("_ ").lower() if match else ""
    if match is None or _SIGN_WORDS.search(word):
        return None
    says_so = not ANGLE_WORDS.isdisjoint(re.split("[_ ]+", word)) or re.search("[-+.]", match["angle"]) is not None
    unit = UNIT_OF_WORD[match["unit"].lower()] if match["unit"] else "deg"
    # Rounded, because 100 gon are not 90.00000000000001 degrees.
    angle_deg = float(match["angle"]) if unit == "deg" else round(float(match["angle"]) * DEG_PER[unit], 4)
    return NamedAngle(angle_deg=angle_deg, word=word, stated=says_so or bool(match["unit"]))


def series_indices(stems: Sequence[str]) -> tuple[list[int], list[int]]:
    """Return the place of each file in a series, from 0, and the numbers that are missing between them.

    The place is the number in the name if a few numbers are missing, else the place in the order of the names.
    """
    parts = [re.fullmatch(r"(.*?)(\d+)(\D*)", stem, re.ASCII) for stem in stems]
    numbers = [int(part[2]) for part in parts if part is not None]
    around = {(part[1], part[3]) for part in parts if part is not None}
    rising = len(around) == 1 and len(numbers) == len(stems) and all(one < two for one, two in pairwise(numbers))
    # If as many numbers are missing as there are files, the names count in another way.
    if not rising or not len(stems) <= numbers[-1] - numbers[0] < 2 * (len(stems) - 1):
        return list(range(len(stems))), []
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers))
    return [number - numbers[0] for number in numbers], missing


def data_folder() -> Path:
    """Return the user's data folder, which may not exist yet; `RecordError` if the system knows none."""
    from platformdirs import user_data_path

    try:
        return user_data_path("markerseek", appauthor=False)
    # A container or service can run under a user number without a name and without HOME.
    except RuntimeError as problem:
        raise RecordError(
            "this user has no home folder; set XDG_DATA_HOME to a folder in which journals are kept"
        ) from problem
