"""Reads a journal, checking every row as it goes; a died run is read as far as it was committed."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from markerseek.core import Finished, Measured, RecordError, Refused, Sample
from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.connection import FOLDED, UNUSED, WITH_LOG, connect, speaking_of
from markerseek.records.journal.entries import Checked, Entry
from markerseek.records.journal.log import look_over
from markerseek.records.journal.rows import from_row
from markerseek.records.journal.store import Row, checksum, followed, log_of, require_file, require_ours, row_checksum


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """All of a journal.

    Attributes
    ----------
    path
        Its file.
    configuration
        What the run was begun with.
    entries
        What happened, in order.
    last_checksum
        Checksum of the last row.
    """

    path: Path
    configuration: Configuration
    entries: tuple[Entry, ...]
    last_checksum: int


@contextmanager
def open_journal(path: Path) -> Iterator[tuple[sqlite3.Connection, RecordError | None]]:
    """Connection to a journal that is not to be changed, nor the log that a dead run left beside it.

    Where that log is damaged, what stands before the damage is read, and what is wrong comes with the connection.

    Raises
    ------
    RecordError
        If there is no such journal, or it is in use.
    """
    path = followed(path)
    with speaking_of(path, verb="read"):
        require_file(path)
        before = _stamps(path)
        try:
            good, damage = _log_beside(path)
            # Where SQLite finds nothing in a log it removes it, which a reader must not do.
            with closing(connect(path, how=WITH_LOG if good > 0 else FOLDED)) as connection:
                yield connection, damage
        finally:
            if _stamps(path) != before:
                raise RecordError(
                    f"{path}: the journal changed while it was read; another markerseek has it open, "
                    "wait until that is over"
                )


def _log_beside(path: Path) -> tuple[int, RecordError | None]:
    """Number of commits in the log of a journal that nobody has open, and what is wrong with it."""
    log = log_of(path)
    if not log.is_file() or log.stat().st_size == 0:
        return 0, None
    _require_unused(path)
    return look_over(log)


def _require_unused(path: Path) -> None:
    """Refuse a journal that a running search has locked; its file and its log change while they are read."""
    try:
        with closing(connect(path, how=UNUSED)) as connection:
            connection.execute("SELECT sql FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.Error as problem:
        # Without leave to write, SQLite cannot recover the log; only whether somebody holds the lock is asked here.
        if problem.sqlite_errorname == "SQLITE_BUSY":
            raise


def _stamps(path: Path) -> list[tuple[int, int]]:
    """Sizes and times of the last change of a journal and its log, which tell whether somebody writes them."""
    parts = [part.stat() for part in (path, log_of(path)) if part.is_file()]
    return [(part.st_size, part.st_mtime_ns) for part in parts]


def read_journal(path: Path, *, frames: bool = True) -> Recording:
    """Everything in a journal.

    Parameters
    ----------
    path
        The file.
    frames
        Whether to keep the frames of the acquisitions, half a megabyte each; they are checked in any case.

    Raises
    ------
    RecordError
        If it cannot be read, is newer than this program, or does not agree with its checksums.
    """
    return whole(*salvage(path, frames=frames))


def whole(held: Recording, damage: RecordError | None) -> Recording:
    """What is held, if nothing is wrong with the rest.

    Raises
    ------
    RecordError
        What is wrong.
    """
    if damage is not None:
        raise damage
    return held


def salvage(
    path: Path, *, frames: bool = True, see: Callable[[Entry], object] | None = None
) -> tuple[Recording, RecordError | None]:
    """As much of a journal as is whole, from its beginning, and what is wrong with the rest.

    Parameters
    ----------
    path
        The file.
    frames
        As in `read_journal`.
    see
        Is called with each entry as it is read, its frame with it.

    Raises
    ------
    RecordError
        If not even the configuration can be read, or it is newer than this program.
    """
    path = followed(path)
    with open_journal(path) as (connection, log_damage):
        try:
            held, damage = recording(connection, path, frames=frames, see=see)
        except RecordError as problem:
            raise log_damage or problem from None
    return held, log_damage or damage


def recording(
    connection: sqlite3.Connection, path: Path, *, frames: bool = True, see: Callable[[Entry], object] | None = None
) -> tuple[Recording, RecordError | None]:
    """As much behind a connection as is whole, and what is wrong with the rest.

    Parameters
    ----------
    connection
        An open journal.
    path
        Its name, for messages.
    frames, see
        As in `salvage`.

    Raises
    ------
    RecordError
        If not even the configuration can be read, or it is newer than this program.
    """
    with speaking_of(path, verb="read"):
        configuration, last = read_configuration(connection, path)
    entries: list[Entry] = []
    damage: RecordError | None = None
    try:
        with speaking_of(path, verb="read"):
            for entry, own_checksum in iterate(connection, path, first_checksum=last):
                if see is not None:
                    see(entry)
                entries.append(entry if frames else _without_frame(entry))
                last = own_checksum
    except RecordError as problem:
        damage = problem
    held = Recording(path=path, configuration=configuration, entries=tuple(entries), last_checksum=last)
    return held, damage


def _without_frame(entry: Entry) -> Entry:
    match entry.event:
        case Measured(sample=sample):
            return replace(entry, event=replace(entry.event, sample=replace(sample, frame=None)))
        case Refused():
            return replace(entry, event=replace(entry.event, frame=None))
        case Finished(confirmation=Sample() as sample):
            return replace(entry, event=replace(entry.event, confirmation=replace(sample, frame=None)))
        case Checked():
            return replace(entry, event=msgspec.structs.replace(entry.event, frame=None))
        case _:
            return entry


def read_configuration(connection: sqlite3.Connection, path: Path) -> tuple[Configuration, int]:
    """Configuration of the run, and its checksum.

    Raises
    ------
    RecordError
        If the file is no journal, or the row is damaged.
    """
    require_ours(connection, path)
    row = connection.execute("SELECT configuration, checksum FROM run").fetchone()
    if row is None or not isinstance(row[0], str) or checksum(0, row[0].encode()) != row[1]:
        raise RecordError(f"{path}: the configuration is damaged; nothing can be told of this run")
    try:
        return msgspec.json.decode(row[0], type=Configuration), row[1]
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"{path}: the configuration cannot be read: {problem}") from problem


def iterate(connection: sqlite3.Connection, path: Path, *, first_checksum: int) -> Iterator[tuple[Entry, int]]:
    """Entries in order with their checksums, one at a time, up to the first that is damaged.

    Parameters
    ----------
    connection, path
        An open journal and its name.
    first_checksum
        Checksum of the configuration.

    Raises
    ------
    RecordError
        At the first row that is missing, damaged or none of ours; those before it have been handed out.
    """
    previous, confirmation = first_checksum, None
    for number, columns in enumerate(connection.execute("SELECT * FROM events ORDER BY number"), start=1):
        row, samples = _checked_row(columns, number=number, previous=previous, path=path)
        entry = _entry(row, samples, path=path, confirmation=confirmation)
        if isinstance(entry.event, Measured) and entry.event.role == "confirmation":
            confirmation = entry.event.sample
        previous = row.checksum
        yield entry, row.checksum


def _checked_row(columns: tuple[object, ...], *, number: int, previous: int, path: Path) -> tuple[Row, bytes | None]:
    """A row and its samples, once it has the number and the checksum that it should have."""
    *plain, samples = columns
    try:
        row = msgspec.convert(plain, Row)
    except msgspec.ValidationError as problem:
        raise RecordError(f"{path}: entry {number} is damaged: {problem}") from problem
    if row.number != number:
        raise RecordError(f"{path}: entry {number} is missing, entry {row.number} follows; the journal is damaged")
    if not (samples is None or isinstance(samples, bytes)) or row_checksum(previous, row, samples) != row.checksum:
        raise RecordError(f"{path}: entry {number} ({row.kind[:20]}) does not agree with its checksum; it is damaged")
    return row, samples


def _entry(row: Row, samples: bytes | None, *, path: Path, confirmation: Sample | None) -> Entry:
    try:
        event = from_row(row.kind, row.body.encode(), samples, confirmation=confirmation)
    except RecordError as problem:
        raise RecordError(f"{path}: entry {row.number} is {problem}") from problem
    checkpoint = None if row.checkpoint is None else row.checkpoint.encode()
    return Entry(number=row.number, written=row.written, clock_s=row.clock_s, event=event, checkpoint=checkpoint)
