"""A study's table on disk: rows as CSV, in parts that are committed whole or not at all.

A number is written with as many digits as bring it back exactly, so that equal rows are equal bytes. An empty field is
a value that does not exist.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import msgspec

from markerseek.core import RecordError
from markerseek.files import open_input, replaced
from markerseek.studies.settings import Value
from markerseek.studies.study import Study, cells
from markerseek.studies.trial import Row

COLUMNS = tuple(name for name in Row.__struct_fields__ if name != "settings")
"""Columns of every table; behind them stand the varied settings of the study, by their keys."""

_MOST_BYTES = 1 << 40
"""Largest table that is read; it is read line by line."""


def columns(study: Study) -> tuple[str, ...]:
    """Names of the columns of a study's table."""
    return COLUMNS + tuple(axis.key for axis in study.vary)


def as_csv(lines: Iterable[Sequence[object]]) -> bytes:
    """Lines of a table, each a sequence of values."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([[_field(value) for value in line] for line in lines])
    return text.getvalue().encode("utf-8")


def values_of(row: Row) -> tuple[object, ...]:
    """Values of a row in the order of `columns`."""
    return tuple(getattr(row, name) for name in COLUMNS) + tuple(value for _, value in row.settings)


def read_rows(path: Path, study: Study) -> Iterator[Row]:
    """Rows of a table, one after another.

    Parameters
    ----------
    path
        The table.
    study
        The study whose table it is.

    Raises
    ------
    RecordError
        If it cannot be read, or is not this study's.
    """
    try:
        with (
            open_input(path, most_bytes=_MOST_BYTES) as file,
            io.TextIOWrapper(file, newline="", encoding="utf-8") as lines,
        ):
            reader = csv.reader(lines)
            if tuple(next(reader, ())) != columns(study):
                raise RecordError(f"{path}: its columns are not those of the study {study.name}")
            by_cell = [cell.varied for cell in cells(study)]
            for line in reader:
                yield _row(line, by_cell)
    except (OSError, UnicodeDecodeError) as problem:
        raise RecordError(f"{path}: the table cannot be read: {problem}") from problem
    except (ValueError, msgspec.ValidationError) as problem:
        raise RecordError(f"{path}: it is not a study's table: {problem}") from problem


def commit(path: Path, content: bytes) -> None:
    """Write a file so that, whatever happens, it is there whole or not at all.

    Parameters
    ----------
    path
        The file; one that exists is replaced.
    content
        What it holds.
    """
    with committed(path) as file:
        file.write(content)


@contextmanager
def committed(path: Path) -> Iterator[BinaryIO]:
    """A file to write, which takes its name only when the block ends well.

    Raises
    ------
    RecordError
        If it cannot be written.
    """
    try:
        with replaced(path) as part, part.open("xb") as file:
            yield file
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror}") from problem


def _field(value: object) -> object:
    if isinstance(value, tuple):
        return " ".join(repr(part) for part in value)
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else value


def _row(line: list[str], by_cell: list[tuple[tuple[str, Value], ...]]) -> Row:
    named: dict[str, object] = {
        name: None if text == "" else text for name, text in zip(COLUMNS, line[: len(COLUMNS)], strict=True)
    }
    marks = line[COLUMNS.index("marks_deg")]
    named["marks_deg"] = [float(part) for part in marks.split()]
    return msgspec.convert({**named, "settings": by_cell[int(line[2])]}, Row, strict=False)
