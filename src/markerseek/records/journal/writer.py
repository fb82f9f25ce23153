"""Writes a journal: each event in one transaction, which is on the disk when `commit` returns."""

from __future__ import annotations

import os
import sqlite3
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from markerseek.core import Failed, Finished
from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.entries import Entry, Happening, Interrupted
from markerseek.records.journal.reader import Recording, recording, whole
from markerseek.records.journal.rows import to_row
from markerseek.records.journal.store import (
    APPLICATION,
    PAGE_BYTES,
    SCHEMA,
    VERSION,
    Row,
    checksum,
    connect,
    require_file,
    row_checksum,
    speaking_of,
    taken,
)


class Journal:
    """The journal of one run, open for writing; made by `create` or `reopen`.

    Attributes
    ----------
    path
        Its file.
    configuration
        What the run was begun with.
    """

    def __init__(self, held: Recording, connection: sqlite3.Connection) -> None:
        self.path = held.path
        self.configuration = held.configuration
        self._connection = connection
        self._number = len(held.entries)
        self._checksum = held.last_checksum
        self._last = held.entries[-1].event if held.entries else None
        self._clock_s = held.entries[-1].clock_s if held.entries else 0.0

    @classmethod
    def create(cls, path: Path, configuration: Configuration) -> Self:
        """New journal, with the configuration committed.

        Raises
        ------
        RecordError
            If the file exists or cannot be written.
        """
        with speaking_of(path, verb="written"):
            try:
                path.open("xb").close()
            except FileExistsError as problem:
                raise taken(path) from problem
            connection = connect(path, mode="rw")
            try:
                first = _lay_out(connection, configuration)
                _sync_folder(path.parent)
            except BaseException:
                connection.close()
                raise
        held = Recording(path=path, configuration=configuration, entries=(), last_checksum=first)
        return cls(held, connection)

    @classmethod
    def reopen(cls, path: Path) -> tuple[Self, Recording]:
        """Journal of a run that goes on, and what it holds so far.

        Raises
        ------
        RecordError
            If the file cannot be read to its end or written, or another program has it open.
        """
        with speaking_of(path, verb="written"):
            require_file(path)
            connection = connect(path, mode="rw")
            try:
                # Takes the lock, and says at once if the file cannot be written.
                connection.execute("BEGIN IMMEDIATE")
                connection.execute("ROLLBACK")
                held = whole(*recording(connection, path))
            except BaseException:
                connection.close()
                raise
        return cls(held, connection), held

    def commit(self, event: Happening, *, clock_s: float, checkpoint: bytes | None = None) -> Entry:
        """Put an event on the disk; once this returns, it is there for good.

        Parameters
        ----------
        event
            What happened.
        clock_s
            The rig's clock in seconds.
        checkpoint
            State of the simulated world after it, as JSON; None where there is none.

        Raises
        ------
        RecordError
            If it cannot be written; what was committed before stays as it was.
        """
        kind, body, samples = to_row(event)
        row = Row(
            number=self._number + 1,
            kind=kind,
            written=datetime.now(UTC).isoformat(),
            clock_s=float(clock_s),
            body=body.decode(),
            checkpoint=None if checkpoint is None else checkpoint.decode(),
            checksum=0,
        )
        found = row_checksum(self._checksum, row, samples)
        columns = (row.number, row.kind, row.written, row.clock_s, row.body, row.checkpoint, found, samples)
        with speaking_of(self.path, verb="written"):
            _transact(self._connection, ("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)", columns))
        self._number, self._checksum = row.number, found
        self._last, self._clock_s = event, row.clock_s
        return Entry(number=row.number, written=row.written, clock_s=row.clock_s, event=event, checkpoint=checkpoint)

    def interrupt(self, reason: str) -> None:
        """Note that the run was stopped from outside, once the rig has been stopped; nothing, if it is over anyway.

        Parameters
        ----------
        reason
            What stopped it.

        Raises
        ------
        RecordError
            If it cannot be written.
        """
        if not isinstance(self._last, Finished | Failed | Interrupted | None):
            self.commit(Interrupted(reason=reason), clock_s=self._clock_s)

    def fail(self, error: Exception, *, clock_s: float) -> None:
        """Note what ended the run; nothing, if it is over or has failed already.

        Parameters
        ----------
        error
            What ended it.
        clock_s
            The run's clock in seconds.

        Raises
        ------
        RecordError
            If it cannot be written.
        """
        if not isinstance(self._last, Finished | Failed):
            self.commit(Failed(error=error), clock_s=clock_s)

    @property
    def last(self) -> Happening | None:
        """What was committed last; None before the first."""
        return self._last

    def close(self) -> None:
        """Fold the write-ahead log into the file and let go of it; allowed twice.

        Raises
        ------
        RecordError
            If that fails; what was committed is in the file and its log.
        """
        with speaking_of(self.path, verb="written"):
            self._connection.close()

    def __enter__(self) -> Self:
        """The journal itself."""
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()


def _lay_out(connection: sqlite3.Connection, configuration: Configuration) -> int:
    """Make the tables with the configuration in one transaction; its checksum comes back."""
    encoded = msgspec.json.encode(configuration)
    first = checksum(0, encoded)
    connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
    if mode != "wal":
        raise sqlite3.OperationalError(f"the folder's file system allows no write-ahead log, only {mode}")
    _transact(
        connection,
        *((sql, ()) for sql in SCHEMA),
        ("INSERT INTO run VALUES (1, ?, ?)", (encoded.decode(), first)),
        (f"PRAGMA application_id = {APPLICATION}", ()),
        (f"PRAGMA user_version = {VERSION}", ()),
    )
    return first


def _transact(connection: sqlite3.Connection, *statements: tuple[str, tuple[object, ...]]) -> None:
    """Run statements in one transaction: all or none."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        for sql, values in statements:
            connection.execute(sql, values)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _sync_folder(folder: Path) -> None:
    """Put the name of a new file on the disk; SQLite does so for its own files only."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
