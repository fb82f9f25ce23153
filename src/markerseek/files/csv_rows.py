"""Splits the text of a CSV into rows: separator, names of the columns, lines that hold no data, notation of numbers.

Which sign separates decimals and which thousands is decided for a whole table, never for a cell.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files.inputs import read_text

DECIMAL_COMMA = (
    "a number with a decimal comma, or with parted thousands, needs quotes or columns that semicolons separate"
)
"""Cure of a row with more columns than the table has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvRows:
    """Rows of a table."""

    names: tuple[str, ...]
    """Names of the columns; empty if the first row holds numbers."""
    width: int
    separator: str
    cells: dict[int, list[str]] = field(repr=False)
    """Cells of each row of data, by the line of the file on which the row ends."""

    def numbers(
        self, path: Path, columns: Sequence[int], *, most: Sequence[float | None] | None = None
    ) -> dict[int, list[str]]:
        """Return the cells of these columns by their line, their numbers as Python writes them; see `plain_numbers`."""
        texts = [{line: "".join(row[each : each + 1]).strip() for line, row in self.cells.items()} for each in columns]
        # Without names, "-35,5 387" may be -35.5 and 387 as well as -35 and 5387.
        spaces = bool(self.names) or self.separator != ","
        read = plain_numbers(path, texts, most=most or [None] * len(columns), spaces=spaces)
        return {line: [cells[line] for cells in read] for line in self.cells}


def csv_rows(path: Path, *, most_bytes: int, what: str, cure: str) -> CsvRows:
    """Return the rows of a table in a file; parameters and errors as of `read_text`."""
    # Windows programs write a degree sign or an umlaut of a heading as one byte.
    text = read_text(path, most_bytes=most_bytes, what=what, cure=cure, also=["cp1252"])
    if not text.strip():
        raise RecordError(f"{path}: this is empty, and {what} is expected; {cure}")
    first_line = next((line for line in text.splitlines() if line.strip()), "")
    # Excel writes the separator into this line.
    named = first_line.lower().startswith("sep=") and len(first_line) == len("sep=,")
    uncommented = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), first_line)
    separator = first_line[-1] if named else _separator(uncommented)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True, skipinitialspace=True)
    try:
        table = [
            (reader.line_num, row)
            for row in reader
            # Spreadsheets append empty rows.
            if any(cell.strip() for cell in row) and not row[0].lower().startswith("sep=")
        ]
    except csv.Error as problem:
        # Its message speaks of quotes and delimiters.
        raise RecordError(
            f"{path}, line {reader.line_num}: this is not in rows and columns, and {what} is expected; {cure}"
        ) from problem
    # NumPy writes the names as a comment.
    comments = [row for _, row in takewhile(lambda each: each[1][0].startswith("#"), table)]
    cells = {line: row for line, row in table if not row[0].startswith("#")}
    first = next(iter(cells), None)
    numbers = [is_number(cell) for cell in cells[first]] if first is not None else []
    names: tuple[str, ...] = ()
    # Below a comment, which may hold the names, a row with some numbers is one of data that lacks the others.
    if first is not None and not (any(numbers) if comments else all(numbers)):
        names = tuple(cell.strip() for cell in cells.pop(first))
    elif comments and (first is None or len(comments[-1]) == len(numbers)):
        names = tuple(cell.strip() for cell in comments[-1])
        names = (names[0].removeprefix("#").strip(), *names[1:])
    width = len(names or next(iter(cells.values()), ()))
    return CsvRows(names=names, width=width, separator=separator, cells=cells)


def _separator(line: str) -> str:
    # Not csv.Sniffer, which takes the comma for the separator in lines such as "-1,5;2,5". The first line decides:
    # headings have no decimal commas, and a table of numbers with decimal commas has another separator as well.
    return next((each for each in (";", "\t", ",") if each in line), " ")


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
        """Return the number as Python writes it; `text` fits the pattern."""
        return text.replace(_SPACE, "").replace(self.thousands, "").replace(self.point, ".")


def _notation(point: str, thousands: str) -> Notation:
    p = re.escape(point)
    t = re.escape(thousands)
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
    """Return whether a cell holds a finite number in any notation, or another that Python reads, such as ``nan``."""
    text = cell.strip().translate(_PLAIN)
    if any(each.pattern.fullmatch(text) for each in _NOTATIONS):
        return True
    try:
        float(text)
    except ValueError:
        return False
    return True


def may_be_number(cell: str) -> bool:
    """Return whether a cell that could not be read looks like a number, with a unit or in a notation of its own."""
    return _UNREAD.fullmatch(cell.strip()) is not None


def plain_numbers(
    path: Path, columns: Sequence[Mapping[int, str]], *, most: Sequence[float | None], spaces: bool
) -> list[dict[int, str]]:
    """Return the cells of columns with their numbers as Python writes them; a cell that is no number stays as it is.

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
    """Return the notations that fit all numbers of a column; refused if none does."""
    left = _NOTATIONS
    last = next(iter(cells), 0)
    for line, text in cells.items():
        fitting = [each for each in left if each.pattern.fullmatch(text)]
        if not fitting and any(each.pattern.fullmatch(text) for each in _NOTATIONS):
            raise RecordError(
                f"{path}, line {line}: {text} and {cells[last]} (line {last}) are written in two notations; save all "
                "numbers in one, best without thousands separators and with a decimal point"
            )
        if fitting and len(fitting) < len(left):
            left = fitting
            last = line
    if most is None or len(left) == 1:
        return left
    numbers = [text for text in cells.values() if left[0].pattern.fullmatch(text)]
    return [each for each in left if all(abs(float(each.plain(text))) <= most for text in numbers)] or left


def _plain(path: Path, cells: Mapping[int, str], left: Sequence[Notation], *, scaled: bool) -> dict[int, str]:
    """Return the cells of a column whose numbers have one reading; refused if they have several.

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
