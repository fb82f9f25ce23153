"""Reads a journal and checks the checksum of every row; a run that died has all rows that were committed.

`read_journal` refuses a damaged journal, `salvage` reads its undamaged beginning, and `verify` reports all damage.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from markerseek.core import Failed, Finished, Measured, RecordError, Refused, Sample, Started
from markerseek.records.configuration import Configuration
from markerseek.records.journal.connection import as_record_error, opened_for_reading, resolve_link
from markerseek.records.journal.encoding import decode
from markerseek.records.journal.events import Checked, Entry
from markerseek.records.journal.schema import Row, checksum, require_schema, row_checksum, stored_tail
from markerseek.records.journal.sequence import angle_faults, order_faults
from markerseek.records.result import Recorder, SearchResult

_MAX_COMPLAINTS = 20
"""Most messages of SQLite's integrity check that are reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """Configuration and entries of one run, as read from its journal."""

    path: Path
    configuration: Configuration
    """Plan, rig and versions of the run."""
    entries: tuple[Entry, ...]
    """The entries, in order."""
    last_checksum: int
    """Checksum of the last row."""


class JournalCheck(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a check."""

    entries: int
    """Number of entries that can be read and agree with their checksums, from the first on."""
    faults: list[str]
    """What is wrong, in words; empty for a whole journal."""


def read_journal(path: Path, *, frames: bool = True) -> RecordedRun:
    """Read a whole journal.

    ``frames``: whether to keep the frames of the acquisitions, half a megabyte each; they are checked in any case.
    """
    recorded, damage = salvage(path, frames=frames)
    if damage is not None:
        raise damage
    return recorded


def salvage(
    path: Path, *, frames: bool = True, on_entry: Callable[[Entry], object] | None = None
) -> tuple[RecordedRun, RecordError | None]:
    """Read the undamaged beginning of a journal; returns it with the error of the first damaged row, or None.

    ``on_entry``: called with each entry as it is read, with its frame. Raises `RecordError` if not even the
    configuration can be read, or a newer program wrote it.
    """
    path = resolve_link(path)
    with opened_for_reading(path) as connection:
        return _salvaged(connection, path, frames=frames, on_entry=on_entry)


def verify(path: Path) -> JournalCheck:
    """Check a journal: pages, checksums, order of the events, and angles."""
    faults: list[str] = []
    path = resolve_link(path)
    with opened_for_reading(path) as connection:
        # Both checks on one connection, so that nobody writes in between.
        recorded, damage = _salvaged(connection, path, frames=False)
        try:
            with as_record_error(path, verb="read"):
                complaints = connection.execute(f"PRAGMA integrity_check({_MAX_COMPLAINTS})").fetchall()
        except RecordError as problem:
            faults.append(str(problem))
        else:
            faults += [f"SQLite: {line}" for (text,) in complaints if text != "ok" for line in text.splitlines()]
    if damage is not None:
        faults.append(str(damage))
    wrong = [*order_faults(recorded.entries), *angle_faults(recorded.configuration, recorded.entries)]
    faults += [f"entry {number}: {reason}" for number, reason in sorted(wrong)]
    return JournalCheck(entries=len(recorded.entries), faults=faults)


def result_of(recorded: RecordedRun) -> tuple[Recorder, SearchResult]:
    """Result of a run that is over, and the recorder that collected it.

    Raises `SearchError` if the run is not over, or ended with a fault.
    """
    recorder = Recorder()
    for entry in recorded.entries:
        if isinstance(entry.event, Started | Measured | Refused | Finished | Failed):
            recorder.add(entry.event)
    return recorder, recorder.result(recorded.configuration.plan, recorded.configuration.facts)


def _salvaged(
    connection: sqlite3.Connection, path: Path, *, frames: bool, on_entry: Callable[[Entry], object] | None = None
) -> tuple[RecordedRun, RecordError | None]:
    """`salvage` for a journal that is open already."""
    with as_record_error(path, verb="read"):
        configuration, last = read_configuration(connection, path)
    entries: list[Entry] = []
    damage: RecordError | None = None
    try:
        with as_record_error(path, verb="read"):
            for entry, own_checksum in iterate(connection, path, first_checksum=last):
                if on_entry is not None:
                    on_entry(entry)
                # A search of 40 acquisitions has 20 MB of frames; a list of many journals needs none of them.
                entries.append(entry if frames else _without_frame(entry))
                last = own_checksum
    except RecordError as problem:
        damage = problem
    recorded = RecordedRun(path=path, configuration=configuration, entries=tuple(entries), last_checksum=last)
    return recorded, damage


def _without_frame(entry: Entry) -> Entry:
    match entry.event:
        case Measured(sample=sample):
            return replace(entry, event=replace(entry.event, sample=replace(sample, frame=None)))
        case Finished(confirmation=Sample() as sample):
            return replace(entry, event=replace(entry.event, confirmation=replace(sample, frame=None)))
        case Refused() | Checked():
            return replace(entry, event=replace(entry.event, frame=None))
        case _:
            return entry


def read_configuration(connection: sqlite3.Connection, path: Path) -> tuple[Configuration, int]:
    """Configuration of the run, and its checksum."""
    try:
        require_schema(connection)
    except RecordError as problem:
        raise RecordError(f"{path}: {problem}") from None
    row = connection.execute("SELECT configuration, checksum FROM run").fetchone()
    if row is None or not isinstance(row[0], str) or checksum(0, row[0].encode()) != row[1]:
        raise RecordError(f"{path}: the configuration is damaged; nothing is known of this run")
    try:
        return msgspec.json.decode(row[0], type=Configuration), row[1]
    except (msgspec.MsgspecError, RecursionError) as problem:
        # Its checksum agrees, so that it is not damaged.
        raise RecordError(
            f"{path}: the configuration cannot be read: {problem}; another version of markerseek wrote it: use that one"
        ) from problem


def iterate(connection: sqlite3.Connection, path: Path, *, first_checksum: int) -> Iterator[tuple[Entry, int]]:
    """Entries in order with their checksums, one at a time, up to the first that is damaged.

    Raises `RecordError` at the first row that is missing or damaged, or where the number of rows is not the number that
    was committed; the rows before it have been yielded.
    """
    number, previous, confirmation = 0, first_checksum, None
    # One row at a time: all frames together may not fit into memory.
    for number, columns in enumerate(connection.execute("SELECT * FROM events ORDER BY number"), start=1):
        row, samples = _checked_row(columns, number=number, previous=previous, path=path)
        entry = _entry(row, samples, path=path, confirmation=confirmation)
        if isinstance(entry.event, Measured) and entry.event.role == "confirmation":
            # `Finished` is stored without its confirmation, which is this sample.
            confirmation = entry.event.sample
        previous = row.checksum
        yield entry, row.checksum
    entries, last = stored_tail(connection)
    if (entries, last) != (number, previous):
        raise RecordError(
            f"{path}: {entries} entries were committed, and {number} are there; the end of the journal is damaged"
        )


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
        event = decode(row.kind, row.body.encode(), samples, confirmation=confirmation)
    except RecordError as problem:
        raise RecordError(f"{path}: entry {row.number} is {problem}") from problem
    checkpoint = None if row.checkpoint is None else row.checkpoint.encode()
    return Entry(number=row.number, written=row.written, clock_s=row.clock_s, event=event, checkpoint=checkpoint)
