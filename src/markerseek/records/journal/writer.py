"""Writes a journal: one entry an event, on the disk when `commit` returns."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Self

from markerseek.core import Failed, Finished, RecordError
from markerseek.files import quoted
from markerseek.records.journal.entries import Configuration, Interrupted, JournalEntry, JournalEvent, without_frame
from markerseek.records.journal.file import as_journal_error, exists_error, open_for_reading
from markerseek.records.journal.line_file import LineFile
from markerseek.records.journal.lines import FORMAT_VERSION, EntryReader, entry_line, first_line
from markerseek.records.journal.reader import RecordedRun


class Journal:
    """The journal of one run, open for writing; made by `create` or `reopen`."""

    def __init__(self, lines: LineFile, configuration: Configuration, last: JournalEntry | None) -> None:
        self.path = lines.path
        self.configuration = configuration
        self.before_entry: Callable[[int, JournalEvent], None] | None = None
        """Called with number and event of each entry before it is written; must raise nothing."""
        self._lines = lines
        self._last = last
        self._lost = False

    @classmethod
    def create(cls, path: Path, configuration: Configuration, *, kept: bool = True) -> Self:
        """Return the new journal, with the configuration committed.

        ``kept``: as of `LineFile`. Raises `RecordError` if the file exists or cannot be written; nothing is left
        behind.
        """
        try:
            line = first_line(configuration)
        except RecordError as problem:
            raise RecordError(f"{path}: {problem}") from problem
        with as_journal_error(path, verb="written"):
            if path.exists() or path.is_symlink():
                raise exists_error(path)
            return cls(LineFile.create(path, line, kept=kept), configuration, None)

    @classmethod
    def reopen(cls, path: Path) -> tuple[Self, RecordedRun]:
        """Open the journal of a run to continue it; returns it and its entries so far.

        An entry that was never finished, because its process died, is cut off.
        """
        entries: list[JournalEntry] = []

        def read(descriptor: int) -> EntryReader:
            reader = EntryReader(path, descriptor)
            if reader.version != FORMAT_VERSION:
                raise RecordError(
                    f"{path}: it was written by an older markerseek: `read_journal({quoted(path)})` and "
                    f"`answer_again({quoted(path)})` read it, but it cannot be resumed; begin a new search"
                )
            while (entry := reader.next()) is not None:
                entries.append(entry)
            return reader

        with as_journal_error(path, verb="written"):
            os.close(open_for_reading(path))
            lines, reader = LineFile.reopen(path, read)
        recorded = RecordedRun(path=path, configuration=reader.configuration, entries=tuple(entries))
        return cls(lines, reader.configuration, entries[-1] if entries else None), recorded

    @property
    def kept(self) -> bool:
        """Whether it outlives the run."""
        return self._lines.kept

    def commit(self, event: JournalEvent, *, clock_s: float) -> JournalEntry:
        """Write an event to disk; once this returns, it survives the death of the process.

        Raises `RecordError` if it cannot be written, or the file was changed or deleted; earlier entries are not
        changed.
        """
        self._require_present()
        number = 1 if self._last is None else self._last.number + 1
        if self.before_entry is not None:
            self.before_entry(number, event)
        entry = JournalEntry(
            number=number,
            written=datetime.now(UTC).isoformat(),
            clock_s=clock_s,
            event=event if self.configuration.frames else without_frame(event),
        )
        data = entry_line(entry)
        end = self._lines.end
        try:
            with as_journal_error(self.path, verb="written"):
                self._lines.append(data)
        finally:
            # A signal can arrive when all of it is written: then it stays.
            if self._lines.end > end:
                self._last = entry
        return entry

    def _require_present(self) -> None:
        """Raise a `RecordError` if the file was changed or deleted."""
        with as_journal_error(self.path, verb="written"):
            self._lost = self._lines.is_changed()
        if self._lost:
            raise RecordError(
                f"{self.path}: it was changed, removed or replaced while the run was written; "
                f"`read_journal({quoted(self.path)})` prints as much of it as is whole"
            )

    def interrupt(self, reason: str) -> None:
        """Record that the run was interrupted, once the rig has been stopped; does nothing if it is over.

        Raises `RecordError` if it cannot be written.
        """
        if not isinstance(self.last, Finished | Failed | Interrupted | None):
            self.commit(Interrupted(reason=reason), clock_s=self.clock_s)

    def fail(self, error: Exception, *, clock_s: float) -> None:
        """Record the error that ended the run; does nothing if it is over or has failed already."""
        if not isinstance(self.last, Finished | Failed):
            self.commit(Failed(error=error), clock_s=clock_s)

    @property
    def last(self) -> JournalEvent | None:
        """What was committed last; None before the first."""
        return None if self._last is None else self._last.event

    @property
    def clock_s(self) -> float:
        """Clock of the run at what was committed last, in seconds; 0 before the first."""
        return 0.0 if self._last is None else self._last.clock_s

    def close(self) -> None:
        """Release the file; allowed twice.

        Raises `RecordError` if the file was changed or deleted, as in `commit`.
        """
        if not self._lines.is_open:
            return
        try:
            # It was said before.
            if not self._lost:
                self._require_present()
        finally:
            with as_journal_error(self.path, verb="closed"):
                self._lines.close()

    def __enter__(self) -> Self:
        """Return the journal itself."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Close it; an error of closing does not replace one of the block."""
        with contextlib.suppress(*(() if kind is None else (RecordError,))):
            self.close()
