"""The table of a study: its rows as CSV, computed in chunks, and read again.

Numbers have all digits, so that reading gives the same numbers and equal rows are equal bytes. An empty field is a
missing value.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from markerseek.core import RecordError
from markerseek.files import open_input, replace_file
from markerseek.studies.settings import Value
from markerseek.studies.study import Study, cells
from markerseek.studies.trial import Row, run_trial

COLUMNS = tuple(name for name in Row.__struct_fields__ if name != "settings")
"""Columns of every table; the varied settings of the study follow, by their keys."""

_MAX_BYTES = 1 << 40
"""Largest table that is read; it is read line by line."""

_CHUNK_ROWS = {"curves": 250, "readings": 64, "frames": 16}
"""Rows of a chunk, about: at most a second of work, so that little is lost when a study is interrupted, and no worker
waits long for the last one."""


def columns(study: Study) -> tuple[str, ...]:
    """Names of the columns of a study's table."""
    return COLUMNS + tuple(axis.key for axis in study.vary)


def as_csv(lines: Iterable[Sequence[object]]) -> bytes:
    """Lines of a table, each a sequence of values."""
    text = io.StringIO()
    # The default of the csv module is CRLF, on every system.
    csv.writer(text, lineterminator="\n").writerows([[_field(value) for value in line] for line in lines])
    return text.getvalue().encode("utf-8")


def values_of(row: Row) -> tuple[object, ...]:
    """Values of a row in the order of `columns`."""
    return tuple(getattr(row, name) for name in COLUMNS) + tuple(value for _, value in row.settings)


def chunks(study: Study) -> Iterator[range]:
    """Trials of each chunk, counted through all cells; a continued study has the same chunks."""
    trials = range(len(cells(study)) * study.trials)
    # Whole trials: the policies of a trial share its window and its curve, which are cached.
    size = max(1, _CHUNK_ROWS[study.level] // len(study.policies))
    return (trials[first : first + size] for first in trials[::size])


def run_chunk(study: Study, trials: range) -> bytes:
    """Lines of the rows of some trials in the table, the same in any process."""
    everything = cells(study)
    rows = (
        run_trial(study, everything[place // study.trials], place % study.trials, policy)
        for place in trials
        for policy in range(len(study.policies))
    )
    return as_csv(values_of(row) for row in rows)


def read_rows(path: Path, study: Study) -> Iterator[Row]:
    """Rows of a table, one after another."""
    try:
        with (
            open_input(path, most_bytes=_MAX_BYTES) as file,
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
    except (ValueError, IndexError, msgspec.ValidationError) as problem:
        raise RecordError(f"{path}: it is not a study's table: {problem}") from problem


def write_whole(path: Path, parts: Iterable[bytes]) -> None:
    """Write a file so that it is there completely or not at all, whatever happens.

    ``path``: an existing one is replaced. ``parts``: its content, in order.
    """
    try:
        with replace_file(path) as unfinished, unfinished.open("xb") as file:
            file.writelines(parts)
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror}") from problem


def _field(value: object) -> object:
    if isinstance(value, tuple):
        return " ".join(repr(part) for part in value)
    if isinstance(value, bool):
        return "true" if value else "false"
    # `repr` has as many digits as are needed to read the same double.
    return repr(value) if isinstance(value, float) else value


def _row(line: list[str], by_cell: list[tuple[tuple[str, Value], ...]]) -> Row:
    named = dict(zip(COLUMNS, line[: len(COLUMNS)], strict=True))
    values = {name: text or None for name, text in named.items()}
    marks_deg = [float(part) for part in named["marks_deg"].split()]
    # The settings of the cell are taken from the study: read as text, a value would lose its type.
    settings = by_cell[int(named["cell"])]
    return msgspec.convert({**values, "marks_deg": marks_deg, "settings": settings}, Row, strict=False)
