"""Names of files and groups: their natural order, and the angles in them; and the folder of the user's own files."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TypeAlias

from markerseek.core import RecordError

# A hyphen behind a letter or digit separates: img-2 is 2, and 2024-05-03 is a date.
_NUMBER = re.compile(r"(?:(?<![a-z0-9.)])-)?\d+(?:\.\d+)*", re.ASCII | re.IGNORECASE)
_ANGLE = re.compile(
    r"(?P<word>[a-z_ ]*)(?P<angle>(?<![a-z])[-+](?:\d+(?:\.\d+)?|\.\d+)|\d+(?:\.\d+)?|\.\d+)(?P<unit>[_ ]?(?:deg|°))?",
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
    """Key that sorts names by the numbers in them: frame2 before frame10, and -10.0 before 2.5."""
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
    """Paths sorted by their last names, as `natural` sorts."""
    return sorted(paths, key=lambda path: natural(path.name))


def endings(paths: Iterable[Path]) -> str:
    """Endings of the names of files, for messages: ".gif, .webp"; "no files" if there are none."""
    found = sorted({path.suffix.lower() or "no ending" for path in paths if not path.name.startswith(".")})
    return ", ".join(found) or "no files"


def angle_in(name: str) -> NamedAngle | None:
    """The angle in degrees in a name without suffix, such as ``-12.5`` or ``angle_-12.5deg``; None: in doubt."""
    match = _ANGLE.fullmatch(name)
    word = match["word"].strip("_ ").lower() if match else ""
    if match is None or _SIGN_WORDS.search(word):
        return None
    stated = bool(match["unit"]) or "angle" in word or re.search("[-+.]", match["angle"]) is not None
    return NamedAngle(angle_deg=float(match["angle"]), word=word, stated=stated)


def data_folder() -> Path:
    """The user's data folder, which may not exist yet; `RecordError` if the system knows none."""
    from platformdirs import user_data_path

    try:
        return user_data_path("markerseek", appauthor=False)
    # A container or service can run under a user number without a name and without HOME.
    except RuntimeError as problem:
        raise RecordError(
            "this user has no home folder; set XDG_DATA_HOME to a folder in which journals are kept"
        ) from problem
