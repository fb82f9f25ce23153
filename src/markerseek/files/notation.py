"""Number notations: which sign separates decimals and which thousands, decided for a whole table, never for a cell."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from markerseek.core import RecordError

_SPACE = "\N{NO-BREAK SPACE}"
"""Stands for every space inside a number."""

_PLAIN = str.maketrans(
    dict.fromkeys(
        "\N{HYPHEN}\N{NON-BREAKING HYPHEN}\N{FIGURE DASH}\N{EN DASH}\N{MINUS SIGN}\N{FULLWIDTH HYPHEN-MINUS}", "-"
    )
    | dict.fromkeys("\N{RIGHT SINGLE QUOTATION MARK}\N{LEFT SINGLE QUOTATION MARK}\N{MODIFIER LETTER APOSTROPHE}", "'")
    | dict.fromkeys(" \N{FIGURE SPACE}\N{THIN SPACE}\N{NARROW NO-BREAK SPACE}", _SPACE)
)
"""One character for each kind of minus, apostrophe and space."""

_UNREAD = re.compile(r"[^\w#]*\d[^#]*")
"""Text whose first word begins with a digit; ``#`` marks what programs write for no number, such as ``1.#QNAN``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Notation:
    """One way to write numbers."""

    point: str
    """The decimal sign."""
    thousands: str
    """The sign between thousands, where there is one."""
    pattern: re.Pattern[str] = field(repr=False)

    def plain(self, text: str) -> str:
        """The number as Python writes it; `text` fits the pattern."""
        return text.replace(_SPACE, "").replace(self.thousands, "").replace(self.point, ".")


def _notation(point: str, thousands: str) -> Notation:
    p, t = re.escape(point), re.escape(thousands)
    # An Indian lakh has groups of two digits.
    lakhs = r"|[1-9]\d?(?:,\d\d)+,\d{3}" if thousands == "," else ""
    pattern = rf"""
        [-+]?{_SPACE}?(?:
            (?:\d+(?:{p}\d*)?|{p}\d+)(?:e[-+]?\d+)?
            |(?:[1-9]\d{{0,2}}(?:{t}\d{{3}})+{lakhs})(?:{p}\d*)?
        )"""
    return Notation(
        point=point, thousands=thousands, pattern=re.compile(pattern, re.ASCII | re.VERBOSE | re.IGNORECASE)
    )


_NOTATIONS = [_notation(point, each) for point in ".," for each in f".,'{_SPACE}" if each != point]


def is_number(cell: str) -> bool:
    """Whether a cell holds a finite number in any notation, or what Python reads as a number, such as ``nan``."""
    text = cell.strip().translate(_PLAIN)
    if any(each.pattern.fullmatch(text) for each in _NOTATIONS):
        return True
    try:
        float(text)
    except ValueError:
        return False
    return True


def may_be_number(cell: str) -> bool:
    """Whether a cell that could not be read looks like a number, with a unit or in a notation of its own."""
    return _UNREAD.fullmatch(cell.strip()) is not None


def plain_numbers(
    path: Path, columns: Sequence[Mapping[int, str]], *, most: Sequence[float | None], spaces: bool
) -> list[dict[int, str]]:
    """Cells of columns with their numbers as Python writes them; a cell that is no number stays as it is.

    A column whose numbers have only one reading is read in that way. The other columns follow the rest of the table, or
    are refused.

    ``columns``: cells by their line, without spaces around them. ``most``: largest magnitude that a number of each
    column can have, if there is one. ``spaces``: whether a space may stand inside a number.
    """
    read = [
        {line: text.translate(_PLAIN) if spaces or " " not in text else text for line, text in cells.items()}
        for cells in columns
    ]
    possible = [_possible(path, cells, limit) for cells, limit in zip(read, most, strict=True)]
    common = [each for each in _NOTATIONS if all(each in known for known in possible)]
    return [
        _plain(path, cells, [each for each in known if each in common] or known, scaled=limit is None)
        for cells, known, limit in zip(read, possible, most, strict=True)
    ]


def _possible(path: Path, cells: Mapping[int, str], most: float | None) -> list[Notation]:
    """Notations that fit all numbers of a column; refused if none does."""
    left, last = _NOTATIONS, next(iter(cells), 0)
    for line, text in cells.items():
        fitting = [each for each in left if each.pattern.fullmatch(text)]
        if not fitting and any(each.pattern.fullmatch(text) for each in _NOTATIONS):
            raise RecordError(
                f"{path}, line {line}: {text} and {cells[last]} (line {last}) are written in two notations; save all "
                "numbers in one, best without thousands separators and with a decimal point"
            )
        if fitting and len(fitting) < len(left):
            left, last = fitting, line
    if most is None or len(left) == 1:
        return left
    numbers = [text for text in cells.values() if left[0].pattern.fullmatch(text)]
    return [each for each in left if all(abs(float(each.plain(text))) <= most for text in numbers)] or left


def _plain(path: Path, cells: Mapping[int, str], left: Sequence[Notation], *, scaled: bool) -> dict[int, str]:
    """Cells of a column whose numbers have one reading; refused if they have several.

    ``scaled``: whether a factor that all numbers have in common is harmless.
    """
    numbers = {line: text for line, text in cells.items() if left[0].pattern.fullmatch(text)}
    for line, text in numbers.items():
        readings = sorted({each.plain(text) for each in left}, key=lambda reading: abs(float(reading)))
        if len(readings) == 1:
            continue
        decimal = next(each for each in left if each.plain(text) == readings[0])
        # If all numbers have three decimals, the other reading is a thousand times as large at all angles.
        if all(text.count(decimal.point) == 1 for text in numbers.values()) and (scaled or decimal.point == "."):
            left = [decimal]
            break
        raise RecordError(
            f"{path}, line {line}: {text} may be {readings[1]} or {readings[0]}, because no number of the table tells "
            f"whether {decimal.point!r} separates decimals or thousands; save the table without thousands separators, "
            "and with as many decimals in each number of the column"
        )
    return {**cells, **{line: left[0].plain(text) for line, text in numbers.items()}}
