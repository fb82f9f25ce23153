"""Writes a journal: one entry an event, on the disk when `commit` returns."""

from __future__ import annotations

import contextlib
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from markerseek.core import Failed, Finished, RecordError
from markerseek.files import create_atomically, open_for_writing
from markerseek.records.journal.entries import Configuration, Entry, Interrupted, JournalEvent
from markerseek.records.journal.file import as_record_error, exists_error, flush, lock, open_for_reading
from markerseek.records.journal.lines import VERSION, EntryReader, entry_line, first_line
from markerseek.records.journal.reader import RecordedRun


class Journal:
    """The journal of one run, open for writing; made by `create` or `reopen`."""

    def __init__(
        self, path: Path, configuration: Configuration, descriptor: int, last: Entry | None, *, end: int, kept: bool
    ) -> None:
        self.path = path
        self.configuration = configuration
        self.kept = kept
        """Whether it outlives the run; what is read by a program that follows the run, and then deleted, is not flushed
        to the disk."""
        self._descriptor = descriptor
        self._open = True
        self._last, self._end = last, end
        self._lost = False

    @classmethod
    def create(cls, path: Path, configuration: Configuration, *, kept: bool = True) -> Self:
        """New journal, with the configuration committed.

        Raises `RecordError` if the file exists or cannot be written; nothing is left behind.
        """
        try:
            line = first_line(configuration)
        except RecordError as problem:
            raise RecordError(f"{path}: {problem}") from problem
        with as_record_error(path, verb="written"), contextlib.ExitStack() as undo:
            if path.exists() or path.is_symlink():
                raise exists_error(path)
            # Under its own name only once it is complete, so that whoever follows it finds its first line.
            with create_atomically(path) as part:
                descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
                undo.callback(os.close, descriptor)
                lock(descriptor)
                _write(descriptor, line, at=0)
            undo.pop_all()
        return cls(path, configuration, descriptor, None, end=len(line), kept=kept)

    @classmethod
    def reopen(cls, path: Path) -> tuple[Self, RecordedRun]:
        """Open the journal of a run to continue it; returns it and its entries so far.

        An entry that was never finished, because its process died, is cut off.
        """
        with as_record_error(path, verb="written"), contextlib.ExitStack() as undo:
            os.close(open_for_reading(path))
            descriptor = open_for_writing(path, os.O_RDWR)
            undo.callback(os.close, descriptor)
            lock(descriptor)
            reader = EntryReader(path, descriptor)
            if reader.version != VERSION:
                raise RecordError(
                    f"{path}: it was written by an older markerseek: 'markerseek journal show' and 'replay' read it, "
                    "but it cannot be resumed; begin a new search"
                )
            entries: list[Entry] = []
            while (entry := reader.next()) is not None:
                entries.append(entry)
            os.ftruncate(descriptor, reader.end)
            undo.pop_all()
        recorded = RecordedRun(path=path, configuration=reader.configuration, entries=tuple(entries))
        last = entries[-1] if entries else None
        return cls(path, reader.configuration, descriptor, last, end=reader.end, kept=True), recorded

    def commit(self, event: JournalEvent, *, clock_s: float) -> Entry:
        """Write an event to disk; once this returns, it survives the death of the process.

        Raises `RecordError` if it cannot be written, or the file was changed or deleted; earlier entries are not
        changed.
        """
        self._require_present()
        before, end = self._last, self._end
        entry = Entry(
            number=1 if before is None else before.number + 1,
            written=datetime.now(UTC).isoformat(),
            clock_s=clock_s,
            event=event,
        )
        data = entry_line(entry)
        with as_record_error(self.path, verb="written"):
            try:
                self._last, self._end = entry, end + len(data)
                _write(self._descriptor, data, at=end)
                if self.kept:
                    flush(self._descriptor)
            except BaseException as problem:
                with contextlib.suppress(OSError):
                    # A signal can arrive when all of it is written: then it stays.
                    if isinstance(problem, OSError) or os.fstat(self._descriptor).st_size < self._end:
                        self._last, self._end = before, end
                        os.ftruncate(self._descriptor, end)
                raise
        return entry

    def _require_present(self) -> None:
        """Raise a `RecordError` if the file was changed or deleted."""
        with as_record_error(self.path, verb="written"):
            status = os.fstat(self._descriptor)
        self._lost = status.st_size != self._end or (status.st_nlink == 0 and self.kept)
        if self._lost:
            raise RecordError(
                f"{self.path}: it was changed, removed or replaced while the run was written; 'markerseek journal "
                "show' prints as much of it as is whole"
            )

    def interrupt(self, reason: str) -> None:
        """Record that the run was interrupted, once the rig has been stopped; does nothing if it is over.

        Raises `RecordError` if it cannot be written.
        """
        if not isinstance(self.last, Finished | Failed | Interrupted | None):
            clock_s = 0.0 if self._last is None else self._last.clock_s
            self.commit(Interrupted(reason=reason), clock_s=clock_s)

    def fail(self, error: Exception, *, clock_s: float) -> None:
        """Record the error that ended the run; does nothing if it is over or has failed already."""
        if not isinstance(self.last, Finished | Failed):
            self.commit(Failed(error=error), clock_s=clock_s)

    @property
    def last(self) -> JournalEvent | None:
        """What was committed last; None before the first."""
        return None if self._last is None else self._last.event

    def close(self) -> None:
        """Release the file; allowed twice.

        Raises `RecordError` if the file was changed or deleted, as in `commit`.
        """
        if not self._open:
            return
        try:
            # It was said before.
            if not self._lost:
                self._require_present()
        finally:
            self._open = False
            with as_record_error(self.path, verb="closed"):
                os.close(self._descriptor)

    def __enter__(self) -> Self:
        """The journal itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close it; an error of closing does not replace one of the block."""
        with contextlib.suppress(*(() if kind is None else (RecordError,))):
            self.close()


def _write(descriptor: int, data: bytes, *, at: int) -> None:
    """Write all of it; a disk that fills up takes a part before it reports so."""
    left = memoryview(data)
    while left:
        written = os.pwrite(descriptor, left, at)
        left, at = left[written:], at + written
