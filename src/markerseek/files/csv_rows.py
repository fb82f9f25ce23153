"""Splits the text of a CSV into rows: separator, names of the columns, lines that hold no data."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files.text import read_text

_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvRows:
    """Rows of a table."""

    names: tuple[str, ...]
    """Names of the columns; empty where the first row holds numbers."""
    width: int
    separator: str
    cells: dict[int, list[str]] = field(repr=False)
    """Cells of each row of data, by the line of the file on which the row ends."""

    def with_point(self, cell: str) -> str:
        """The text of a cell, with a point for a decimal comma where something else separates the columns."""
        text = cell.strip()
        return text.replace(",", ".") if self.separator != "," and "." not in text else text


def csv_rows(path: Path, *, most_bytes: int, what: str, cure: str) -> CsvRows:
    """Rows of a table in a file; parameters and errors as of `read_text`."""
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
    numbers = [_is_number(cell) for cell in cells[first]] if first is not None else []
    names: tuple[str, ...] = ()
    # Below a comment, which may hold the names, a row with some numbers is one of data that lacks the others.
    if first is not None and not (any(numbers) if comments else all(numbers)):
        names = tuple(cell.strip() for cell in cells.pop(first))
    elif comments and (first is None or len(comments[-1]) == len(numbers)):
        names = tuple(cell.strip() for cell in comments[-1])
        names = (names[0].removeprefix("#").strip(), *names[1:])
    width = len(names or next(iter(cells.values()), ()))
    if separator != ",":
        _refuse_thousands(path, cells)
    return CsvRows(names=names, width=width, separator=separator, cells=cells)


def _refuse_thousands(path: Path, cells: dict[int, list[str]]) -> None:
    """Refuse a column with ambiguous commas, decimal or thousands: each has three digits behind it."""
    # By lines, because a row may lack columns.
    for column in range(max(map(len, cells.values()), default=0)):
        numbers = {line: row[column].strip() for line, row in cells.items() if column < len(row)}
        with_comma = {line: text for line, text in numbers.items() if "," in text}
        if 0 < len(with_comma) < len(numbers) and all(map(_THOUSANDS.fullmatch, with_comma.values())):
            line, text = next(iter(with_comma.items()))
            whole, parted = text.replace(",", ""), text.replace(",", ".")
            raise RecordError(
                f"{path}, line {line}: {text} may be {whole} or {parted}, because other numbers of its column have no "
                "comma; write it with a point, or without the comma"
            )


def _separator(line: str) -> str:
    # Not csv.Sniffer, which takes the comma for the separator in lines such as "-1,5;2,5". The first line decides:
    # headings have no decimal commas, and a table of numbers with decimal commas has another separator as well.
    return next((each for each in (";", "\t", ",") if each in line), " ")


def _is_number(cell: str) -> bool:
    try:
        float(cell.strip().replace(",", "."))
    except ValueError:
        return False
    return True
