"""Runs a study into a folder. A study that was interrupted is continued by the same command.

The folder holds ``study.json``, the study that it belongs to; ``rows.part.csv``, to which rows are added in their
order; and at the end, instead of it, ``rows.csv``, and ``summary.json``. The files of a continued study are those of an
uninterrupted one, byte for byte.

In the table numbers have all digits, so that reading gives the same numbers and equal rows are equal bytes. An empty
field is a missing value.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import IO

import msgspec

from markerseek._version import __version__
from markerseek.core import RecordError
from markerseek.files import MIB, open_for_writing, open_input, read_input, replace_file, sync_folder
from markerseek.studies.study import Study, Value, cells
from markerseek.studies.summary import Summary, summarise
from markerseek.studies.trial import Row, run_trial
from markerseek.studies.workers import in_order

STUDY = "study.json"
PART = "rows.part.csv"
ROWS = "rows.csv"
SUMMARY = "summary.json"
"""Names in a study's folder."""

_COLUMNS = tuple(name for name in Row.__struct_fields__ if name != "settings")
"""Columns of every table; the varied settings of the study follow, by their keys."""

_MAX_TABLE_BYTES = 1 << 40
_MAX_JSON_BYTES = 256 * MIB
"""Largest table that is read, line by line, and largest file beside it."""

_CHUNK_ROWS = {"curves": 250, "frames": 1}
"""Rows of a chunk, about: a second of work or one search, so that little is lost when a study is interrupted, and no
worker waits long for the last one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedStudy:
    """A study that has been run."""

    rows: Path
    summary: Summary


def run_study(
    study: Study,
    folder: Path,
    *,
    workers: int | None = None,
    progress: Callable[[int], None] = lambda _rows: None,
) -> FinishedStudy:
    """Run a study, or the rest of it, and summarise it.

    ``folder``: created if it does not exist. ``workers``: processes of this machine; None: as many as it has cores.
    ``progress``: receives the number of finished rows before the first chunk and after each.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise RecordError(
            f"{folder}: the folder cannot be made ({problem.strerror}); name one that can be written, with `out`"
        ) from problem
    with _alone(folder):
        _claim(folder, study)
        if not (folder / ROWS).exists():
            _add_rows(study, folder / PART, workers, progress)
            (folder / PART).replace(folder / ROWS)
            sync_folder(folder)
        progress(study.rows)
        summary = summarise(study, read_rows(folder / ROWS, study))
        _write_json(folder / SUMMARY, summary)
        return FinishedStudy(rows=folder / ROWS, summary=summary)


def _write_json(path: Path, value: object) -> None:
    """Write a value as a JSON file; an existing file is replaced."""
    with _writing(path), replace_file(path) as unfinished:
        unfinished.write_bytes(msgspec.json.format(msgspec.json.encode(value), indent=1) + b"\n")


def _claim(folder: Path, study: Study) -> None:
    """Record the study of the folder, or refuse the folder of another; remove files that were not finished."""
    path = folder / STUDY
    if path.exists():
        try:
            found = msgspec.json.decode(read_input(path, most_bytes=_MAX_JSON_BYTES), type=dict)
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
            raise RecordError(f"{path}: it cannot be read: {problem}") from problem
        if found.get("hash") != study.digest:
            made_by = found.get("version")
            cause = f"was begun by version {made_by}" if made_by != __version__ else "holds another study"
            raise RecordError(
                f"{folder}: the folder {cause} (hash {found.get('hash')}, this one is {study.digest}); "
                "choose another folder, or remove this one"
            )
    else:
        _write_json(path, {"hash": study.digest, "version": __version__, "study": msgspec.to_builtins(study)})
    for unfinished in folder.glob(".*.part"):
        unfinished.unlink()


def _add_rows(study: Study, path: Path, workers: int | None, progress: Callable[[int], None]) -> None:
    """Compute the rows that an unfinished table lacks, and add each chunk as it is ready."""
    with _writing(path):
        descriptor = open_for_writing(path, os.O_RDWR | os.O_CREAT)
    with os.fdopen(descriptor, "r+b") as table:
        done = _whole_trials(table, study)
        progress(done * len(study.policies))
        parts = in_order(partial(run_chunk, study), chunks(study, first=done), workers=workers)
        # Closed at Ctrl-C too: the processes would otherwise continue their jobs.
        with closing(parts):
            for lines in parts:
                with _writing(path):
                    table.write(lines)
                    table.flush()
                    os.fsync(table.fileno())
                done += lines.count(b"\n") // len(study.policies)
                progress(done * len(study.policies))


def _whole_trials(table: IO[bytes], study: Study) -> int:
    """Return the number of whole trials in an unfinished table; what a kill has left behind them is cut off."""
    head = as_csv([columns(study)])
    table.seek(0)
    end = 0
    trials = 0
    if table.readline() == head:
        end = len(head)
        place = end
        for number, line in enumerate(table):
            if not (line.startswith(f"{study.digest},{number},".encode()) and line.endswith(b"\n")):
                break
            place += len(line)
            if (number + 1) % len(study.policies) == 0:
                end = place
                trials = trials + 1
    table.seek(end)
    table.truncate()
    if end == 0:
        table.write(head)
    return trials


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Raise the errors of the disk as `RecordError`."""
    try:
        yield
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror or problem}") from problem


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Lock the folder; the operating system releases the lock however this process ends."""
    try:
        import fcntl
    except ImportError:  # Windows: without the lock, two runs of one study do the work twice and write the same files
        yield
        return
    with os.fdopen(open_for_writing(folder / ".lock", os.O_WRONLY | os.O_CREAT), "wb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as problem:
            raise RecordError(f"{folder}: another process is running this study; wait for it") from problem
        yield


def columns(study: Study) -> tuple[str, ...]:
    """Return the names of the columns of a study's table."""
    return _COLUMNS + tuple(axis.key for axis in study.vary)


def as_csv(lines: Iterable[Sequence[object]]) -> bytes:
    """Return the lines of a table, each a sequence of values."""
    text = io.StringIO()
    # The default of the csv module is CRLF, on every system.
    csv.writer(text, lineterminator="\n").writerows([[_field(value) for value in line] for line in lines])
    return text.getvalue().encode("utf-8")


def values_of(row: Row) -> tuple[object, ...]:
    """Return the values of a row in the order of `columns`."""
    return tuple(getattr(row, name) for name in _COLUMNS) + tuple(value for _, value in row.settings)


def chunks(study: Study, *, first: int = 0) -> Iterator[range]:
    """Return the trials of each chunk from the first on, counted through all cells."""
    trials = range(first, len(cells(study)) * study.trials)
    # Whole trials: the policies of a trial share its curve, which is cached.
    size = max(1, _CHUNK_ROWS[study.level] // len(study.policies))
    return (trials[start : start + size] for start in range(0, len(trials), size))


def run_chunk(study: Study, trials: range) -> bytes:
    """Return the lines of the rows of some trials in the table, the same in any process."""
    everything = cells(study)
    rows = (
        run_trial(study, everything[place // study.trials], place % study.trials, policy)
        for place in trials
        for policy in range(len(study.policies))
    )
    return as_csv(values_of(row) for row in rows)


def read_rows(path: Path, study: Study) -> Iterator[Row]:
    """Yield the rows of a table, one after another."""
    try:
        with (
            open_input(path, most_bytes=_MAX_TABLE_BYTES) as file,
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


def _field(value: object) -> object:
    if isinstance(value, tuple):
        return " ".join(repr(part) for part in value)
    if isinstance(value, bool):
        return "true" if value else "false"
    # `repr` has as many digits as are needed to read the same double.
    return repr(value) if isinstance(value, float) else value


def _row(line: list[str], by_cell: list[tuple[tuple[str, Value], ...]]) -> Row:
    named = dict(zip(_COLUMNS, line[: len(_COLUMNS)], strict=True))
    values = {name: text or None for name, text in named.items()}
    marks_deg = [float(part) for part in named["marks_deg"].split()]
    # The settings of the cell are taken from the study: read as text, a value would lose its type.
    settings = by_cell[int(named["cell"])]
    return msgspec.convert({**values, "marks_deg": marks_deg, "settings": settings}, Row, strict=False)
