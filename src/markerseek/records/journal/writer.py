"""Writes a journal: each event in one transaction, which is on the disk when `commit` returns."""

from __future__ import annotations

import contextlib
import sqlite3
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from markerseek.core import Failed, Finished, RecordError
from markerseek.records.journal.angles import angle_faults
from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.connection import WRITTEN, connect, speaking_of
from markerseek.records.journal.entries import Entry, Happening, Interrupted
from markerseek.records.journal.plain import require_finite
from markerseek.records.journal.presence import Presence, copied
from markerseek.records.journal.reader import Recording, read_journal
from markerseek.records.journal.rows import to_row
from markerseek.records.journal.store import VERSION, Row, log_of, row_checksum, taken, version_of
from markerseek.records.journal.tables import encoded, last_row, lay_out, transact
from markerseek.records.whole_files import sync_folder


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
        self._open = True
        self._version = version_of(connection)
        self._number = len(held.entries)
        self._checksum = held.last_checksum
        self._under_way: tuple[Row, Happening] | None = None
        self._presence = Presence(held.path)
        self._lost: RecordError | None = None
        self._last = held.entries[-1].event if held.entries else None
        self._clock_s = held.entries[-1].clock_s if held.entries else 0.0

    @classmethod
    def create(cls, path: Path, configuration: Configuration) -> Self:
        """New journal, with the configuration committed.

        Raises
        ------
        RecordError
            If the file exists or cannot be written; nothing is left behind.
        """
        as_json = encoded(configuration)
        with speaking_of(path, verb="written"):
            if log_of(path).exists() and not path.exists():
                # SQLite would remove it.
                raise RecordError(
                    f"{path}: the log of a journal that is gone lies there, {log_of(path)}, and may be all that is "
                    "left of a run; name a new file"
                )
            try:
                path.open("xb").close()
            except FileExistsError as problem:
                raise taken(path) from problem
            try:
                connection = connect(path, how=WRITTEN)
                try:
                    first = lay_out(connection, as_json)
                    sync_folder(path.parent)
                except BaseException:
                    connection.close()
                    raise
            except BaseException:
                for made in (path, log_of(path)):
                    made.unlink(missing_ok=True)
                raise
        held = Recording(path=path, configuration=configuration, entries=(), last_checksum=first)
        return cls(held, connection)

    @classmethod
    def reopen(cls, path: Path) -> tuple[Self, Recording]:
        """Journal of a run that goes on, and what it holds so far.

        Raises
        ------
        RecordError
            If the file cannot be read to its end or written, holds an angle outside its limits, or another program has
            it open.
        """
        # Read first: closing a journal that was opened to be written folds its log in, whole or not.
        held = read_journal(path)
        path = held.path
        for number, reason in angle_faults(held.configuration, held.entries):
            raise RecordError(
                f"{path}: entry {number}: {reason}; the journal is damaged or foreign, begin a new search"
            )
        with speaking_of(path, verb="written"):
            connection = connect(path, how=WRITTEN)
            try:
                # Takes the lock, and says at once if the file cannot be written.
                connection.execute("BEGIN IMMEDIATE")
                connection.execute("ROLLBACK")
                _require_unchanged(connection, held)
                return cls(held, connection), held
            except BaseException:
                connection.close()
                raise

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
            If it cannot be written; what was committed before stays as it was. Or if the file is not there any more:
            what was written is then copied to a new one, which the message names, and `path` leads to it.
        """
        if self._lost is not None:
            raise self._lost
        kind, body, samples = to_row(event)
        self._settle()
        row = Row(
            number=self._number + 1,
            kind=kind,
            written=datetime.now(UTC).isoformat(),
            clock_s=require_finite(float(clock_s), what="the rig's clock"),
            body=body.decode(),
            checkpoint=None if checkpoint is None else checkpoint.decode(),
            checksum=0,
        )
        row = msgspec.structs.replace(row, checksum=row_checksum(self._checksum, row, samples))
        insertion = ("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (*msgspec.structs.astuple(row), samples))
        # An older program must not read what it does not understand.
        lift = () if self._version == VERSION else ((f"PRAGMA user_version = {VERSION}", ()),)
        self._under_way = row, event
        with speaking_of(self.path, verb="written"):
            transact(self._connection, insertion, *lift)
        self._note(row, event)
        self._require_present()
        return Entry(number=row.number, written=row.written, clock_s=row.clock_s, event=event, checkpoint=checkpoint)

    def _settle(self) -> None:
        """Ask the file whether the last commit succeeded, if an error or a signal came before that was noted."""
        if self._under_way is None or not self._open:
            return
        row, event = self._under_way
        with speaking_of(self.path, verb="written"):
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            kept = last_row(self._connection) == (row.number, row.checksum)
        if kept:
            self._note(row, event)
        self._under_way = None

    def _require_present(self) -> None:
        """See that what was written lies where it can be found again; copy it to a new file if it does not.

        Raises
        ------
        RecordError
            If the file or its log was removed or replaced; the message says where the copy is, or that there is none.
        """
        with speaking_of(self.path, verb="written"):
            loss = self._presence.loss()
        if loss is None:
            return
        said = f"{self.path}: {loss} was removed or replaced while the run was written"
        try:
            self.path = copied(self._connection, self.path)
        except (OSError, sqlite3.Error, RecordError) as problem:
            self._lost = RecordError(f"{said}, and no copy could be made ({problem}): what it held is gone")
        else:
            self._lost = RecordError(f"{said}; everything up to now is in {self.path}")
        raise self._lost

    def _note(self, row: Row, event: Happening) -> None:
        self._number, self._checksum, self._version = row.number, row.checksum, VERSION
        self._last, self._clock_s = event, row.clock_s
        self._under_way = None

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
        if not isinstance(self.last, Finished | Failed | Interrupted | None):
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
        if not isinstance(self.last, Finished | Failed):
            self.commit(Failed(error=error), clock_s=clock_s)

    @property
    def last(self) -> Happening | None:
        """What was committed last; None before the first."""
        self._settle()
        return self._last

    def close(self) -> None:
        """Fold the write-ahead log into the file and let go of it; allowed twice.

        Raises
        ------
        RecordError
            If the log cannot be folded in; what was committed is in the file and its log. Or if the file is not there
            any more, as in `commit`.
        """
        if not self._open:
            return
        self._open = False
        with speaking_of(self.path, verb="closed"), contextlib.closing(self._connection) as connection:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            if self._lost is not None:
                return
            self._require_present()
            (busy, *_), *_ = connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            if busy:
                raise RecordError(f"{self.path}: the journal's log cannot be folded in: it is in use; nothing is lost")

    def __enter__(self) -> Self:
        """The journal itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Close it; an error that is on its way goes before one of closing, which loses nothing."""
        with contextlib.suppress(*(() if kind is None else (RecordError,))):
            self.close()


def _require_unchanged(connection: sqlite3.Connection, held: Recording) -> None:
    """Refuse a journal that another program wrote after it was read and before it was locked."""
    if last_row(connection) != (len(held.entries), held.last_checksum):
        raise RecordError(f"{held.path}: another markerseek wrote it meanwhile; look at it, then resume it")
