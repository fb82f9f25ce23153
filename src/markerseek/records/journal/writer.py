"""Writes a journal: one transaction per event, flushed to disk when `commit` returns."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Self

import msgspec

from markerseek.core import Failed, Finished, RecordError
from markerseek.files import sync_folder
from markerseek.records.configuration import Configuration
from markerseek.records.journal.connection import (
    as_record_error,
    connect,
    exists_error,
    remove_rollback_file,
    resolve_link,
    rollback_file,
)
from markerseek.records.journal.encoding import encode, json_values
from markerseek.records.journal.events import Entry, Interrupted, JournalEvent
from markerseek.records.journal.file_identity import FileIdentity, copied
from markerseek.records.journal.reader import RecordedRun, read_journal
from markerseek.records.journal.schema import Row, add_row, create_tables, row_checksum, stored_tail
from markerseek.records.journal.sequence import angle_faults


class Journal:
    """The journal of one run, open for writing; made by `create` or `reopen`."""

    def __init__(self, recorded: RecordedRun, connection: sqlite3.Connection) -> None:
        self.path = recorded.path
        self.configuration = recorded.configuration
        self._connection = connection
        self._open = True
        self._file_identity = FileIdentity(recorded.path)
        self._number = len(recorded.entries)
        self._checksum = recorded.last_checksum
        self._uncertain: tuple[Row, JournalEvent, memoryview | None] | None = None
        self._watcher: Callable[[Row, memoryview | None], None] | None = None
        self._lost: RecordError | None = None
        self._last = recorded.entries[-1].event if recorded.entries else None
        self._clock_s = recorded.entries[-1].clock_s if recorded.entries else 0.0

    @classmethod
    def create(cls, path: Path, configuration: Configuration) -> Self:
        """New journal, with the configuration committed.

        Raises `RecordError` if the file exists or cannot be written; nothing is left behind.
        """
        as_json = msgspec.json.encode(json_values(configuration, what="the configuration"))
        try:
            # msgspec checks value ranges only on decoding, and a written journal must be readable.
            msgspec.json.decode(as_json, type=Configuration)
        except msgspec.ValidationError as problem:
            raise RecordError(f"{path}: the configuration cannot be recorded: {problem}") from problem
        path = resolve_link(path)
        with as_record_error(path, verb="written"):
            if rollback_file(path).exists() and not path.exists():
                # SQLite would delete it, and with it the last chance to repair a moved journal.
                raise RecordError(
                    f"{path}: the rollback journal of a file that is gone lies there, {rollback_file(path)}; "
                    "put both together, or name a new file"
                )
            try:
                path.open("xb").close()
            except FileExistsError as problem:
                raise exists_error(path) from problem
            with contextlib.ExitStack() as undo:
                for made in (rollback_file(path), path):
                    undo.callback(made.unlink, missing_ok=True)
                connection = undo.enter_context(contextlib.closing(connect(path, mode="rw")))
                first = create_tables(connection, as_json)
                # The name of a new file is durable only when its folder has been flushed.
                sync_folder(path.parent)
                undo.pop_all()
        recorded = RecordedRun(path=path, configuration=configuration, entries=(), last_checksum=first)
        return cls(recorded, connection)

    @classmethod
    def reopen(cls, path: Path) -> tuple[Self, RecordedRun]:
        """Open the journal of a run to continue it; returns it and its entries so far."""
        path = resolve_link(path)
        # Read from a copy first: the unfinished commit is undone in the file itself only if the copy is undamaged.
        recorded = read_journal(path)
        for number, reason in angle_faults(recorded.configuration, recorded.entries):
            raise RecordError(
                f"{path}: entry {number}: {reason}; the journal is damaged or foreign, begin a new search"
            )
        with as_record_error(path, verb="written"), contextlib.ExitStack() as undo:
            connection = undo.enter_context(contextlib.closing(connect(path, mode="rw")))
            # Takes the lock. SQLite opens a read-only file without an error, so that only a write detects it.
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("UPDATE run SET entries = entries")
            connection.execute("ROLLBACK")
            if stored_tail(connection) != (len(recorded.entries), recorded.last_checksum):
                raise RecordError(f"{path}: another markerseek wrote it meanwhile; look at it, then resume it")
            journal = cls(recorded, connection)
            undo.pop_all()
        return journal, recorded

    def commit(self, event: JournalEvent, *, clock_s: float, checkpoint: bytes | None = None) -> Entry:
        """Write an event to disk; once this returns, it survives the death of the process.

        ``checkpoint``: state of the simulated world after it, as JSON. Raises `RecordError` if it cannot be written;
        earlier entries are not changed. Or if the file was deleted or replaced: it is then copied to a new file, which
        the message names, and `path` is changed to it.
        """
        if self._lost is not None:
            raise self._lost
        encoded = encode(event)
        self._settle()
        self._require_present()
        row = encoded.row(self._number + 1, clock_s=clock_s, checkpoint=checkpoint)
        row = msgspec.structs.replace(row, checksum=row_checksum(self._checksum, row, encoded.samples))
        # A signal can arrive between the commit and the lines after it: `_settle` then asks the file.
        self._uncertain = row, event, encoded.samples
        with as_record_error(self.path, verb="written"):
            add_row(self._connection, row, encoded.samples)
        self._note(row, event, encoded.samples)
        self._require_present()
        return Entry(number=row.number, written=row.written, clock_s=row.clock_s, event=event, checkpoint=checkpoint)

    def _settle(self) -> None:
        """Find out from the file whether the last commit succeeded, after an error or signal in the middle of it."""
        if self._uncertain is None or not self._open:
            return
        row, event, samples = self._uncertain
        with as_record_error(self.path, verb="written"):
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            committed = stored_tail(self._connection) == (row.number, row.checksum)
        if committed:
            self._note(row, event, samples)
        self._uncertain = None

    def _require_present(self) -> None:
        """Copy the journal to a new file and raise a `RecordError` if it was deleted or replaced."""
        with as_record_error(self.path, verb="written"):
            loss = self._file_identity.loss()
        if loss is None:
            return
        finding = f"{self.path}: {loss} was removed or replaced while the run was written"
        try:
            self.path = copied(self._connection, self.path)
        except (OSError, sqlite3.Error, RecordError) as problem:
            self._lost = RecordError(f"{finding}, and no copy could be made ({problem}): what it held is gone")
        else:
            self._lost = RecordError(f"{finding}; everything up to now is in {self.path}")
        raise self._lost

    def _note(self, row: Row, event: JournalEvent, samples: memoryview | None) -> None:
        self._number, self._checksum = row.number, row.checksum
        self._last, self._clock_s = event, row.clock_s
        self._uncertain = None
        if self._watcher is not None:
            self._watcher(row, samples)

    def watch(self, watcher: Callable[[Row, memoryview | None], None]) -> None:
        """Hand the row and the samples of each event to a watcher from now on, after its commit.

        ``watcher``: it must return at once, and raise nothing.
        """
        self._watcher = watcher

    def interrupt(self, reason: str) -> None:
        """Record that the run was interrupted, once the rig has been stopped; does nothing if it is over.

        Raises `RecordError` if it cannot be written.
        """
        if not isinstance(self.last, Finished | Failed | Interrupted | None):
            self.commit(Interrupted(reason=reason), clock_s=self._clock_s)

    def fail(self, error: Exception, *, clock_s: float) -> None:
        """Record the error that ended the run; does nothing if it is over or has failed already."""
        if not isinstance(self.last, Finished | Failed):
            self.commit(Failed(error=error), clock_s=clock_s)

    @property
    def last(self) -> JournalEvent | None:
        """What was committed last; None before the first."""
        self._settle()
        return self._last

    def close(self) -> None:
        """Release the file; allowed twice.

        Raises `RecordError` if SQLite cannot close it; committed entries are in the file. Or if the file was deleted,
        as in `commit`.
        """
        if not self._open:
            return
        self._open = False
        with as_record_error(self.path, verb="closed"), contextlib.closing(self._connection) as connection:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            if self._lost is not None:
                return
            self._require_present()
            remove_rollback_file(connection)

    def __enter__(self) -> Self:
        """The journal itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close it; an error of closing does not replace one of the block."""
        with contextlib.suppress(*(() if kind is None else (RecordError,))):
            self.close()
