"""Splits the text of a CSV into rows: separator, names of the columns, lines that hold no data."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files.notation import is_number, plain_numbers
from markerseek.files.text import read_text

DECIMAL_COMMA = (
    "a number with a decimal comma, or with parted thousands, needs quotes or columns that semicolons separate"
)
"""Cure of a row with more columns than the table has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvRows:
    """Rows of a table."""

    names: tuple[str, ...]
    """Names of the columns; empty where the first row holds numbers."""
    width: int
    separator: str
    cells: dict[int, list[str]] = field(repr=False)
    """Cells of each row of data, by the line of the file on which the row ends."""

    def numbers(
        self, path: Path, columns: Sequence[int], *, most: Sequence[float | None] | None = None
    ) -> dict[int, list[str]]:
        """Cells of these columns by their line, their numbers as Python writes them; see `plain_numbers`."""
        texts = [{line: "".join(row[each : each + 1]).strip() for line, row in self.cells.items()} for each in columns]
        # Without names, "-35,5 387" may be -35.5 and 387 as well as -35 and 5387.
        spaces = bool(self.names) or self.separator != ","
        read = plain_numbers(path, texts, most=most or [None] * len(columns), spaces=spaces)
        return {line: [cells[line] for cells in read] for line in self.cells}


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
