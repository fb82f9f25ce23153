"""A file of lines that only grows: locked by the process that writes it, each line on the disk before it goes on.

The journal of a search and the record of a registration session are such files; `lines` says what a line holds.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Protocol, Self, TypeVar

from markerseek.files import create_atomically, open_for_writing, open_input
from markerseek.records.journal.file import flush, lock


class _Read(Protocol):
    @property
    def end(self) -> int:
        """Bytes of the lines that were read."""


_Reader = TypeVar("_Reader", bound=_Read)


class LineFile:
    """A file of lines, open for writing; made by `create` or `reopen`.

    All methods raise `OSError`, `BlockingIOError` if another process has the file open for writing.
    """

    def __init__(self, path: Path, descriptor: int, *, end: int, kept: bool = True) -> None:
        self.path = path
        self.end = end
        """Bytes that are written."""
        self.kept = kept
        """Whether it outlives the run; what is read by a program that follows the run, and then deleted, is not flushed
        to the disk."""
        self._descriptor = descriptor

    @classmethod
    def create(cls, path: Path, lines: bytes, *, kept: bool = True, mode: int = 0o666) -> Self:
        """Make a new file with its first lines; nothing is left behind if that fails."""
        with ExitStack() as undo:
            # Under its own name only once they are complete, so that whoever follows it finds its first line.
            with create_atomically(path) as part:
                descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, mode)
                undo.callback(os.close, descriptor)
                lock(descriptor)
                _write(descriptor, lines, at=0)
            undo.pop_all()
        return cls(path, descriptor, end=len(lines), kept=kept)

    @classmethod
    def reopen(cls, path: Path, read: Callable[[int], _Reader]) -> tuple[Self, _Reader]:
        """Open a file to continue it; a line that was never finished, because its process died, is cut off.

        ``read``: reads all lines from a descriptor, and returns what it read.
        """
        with ExitStack() as undo:
            # Refuses what is no plain file.
            open_input(path, most_bytes=1 << 62).close()
            descriptor = open_for_writing(path, os.O_RDWR)
            undo.callback(os.close, descriptor)
            lock(descriptor)
            found = read(descriptor)
            os.ftruncate(descriptor, found.end)
            undo.pop_all()
        return cls(path, descriptor, end=found.end), found

    def append(self, line: bytes) -> None:
        """Write a line to the disk; once this returns, it survives the death of the process.

        If it fails, nothing of it is left. A signal can arrive when all of it is written: then it stays, and `end` is
        behind it.
        """
        before = self.end
        try:
            self.end = before + len(line)
            _write(self._descriptor, line, at=before)
            if self.kept:
                flush(self._descriptor)
        except BaseException as problem:
            with suppress(OSError):
                if isinstance(problem, OSError) or os.fstat(self._descriptor).st_size < self.end:
                    self.end = before
                    os.ftruncate(self._descriptor, before)
            raise

    def is_changed(self) -> bool:
        """Return whether another program has changed or removed the file."""
        status = os.fstat(self._descriptor)
        return status.st_size != self.end or (status.st_nlink == 0 and self.kept)

    @property
    def is_open(self) -> bool:
        """Whether it is not closed."""
        return self._descriptor >= 0

    def close(self) -> None:
        """Release the file; allowed twice."""
        if self.is_open:
            descriptor = self._descriptor
            self._descriptor = -1
            os.close(descriptor)


def _write(descriptor: int, data: bytes, *, at: int) -> None:
    """Write all of it; a disk that fills up takes a part before it reports so."""
    left = memoryview(data)
    while left:
        written = os.pwrite(descriptor, left, at)
        left = left[written:]
        at += written
