"""Writes the events of a run to a file or a pipe, and never waits for the reader."""

from __future__ import annotations

import fcntl
import io
import os
import select
import stat
import struct
import termios
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Self

import msgspec

from markerseek.core import RecordError
from markerseek.records.configuration import Configuration
from markerseek.records.journal.encoding import encode, json_values
from markerseek.records.journal.events import Entry, JournalEvent
from markerseek.records.journal.schema import Row
from markerseek.records.stream.lines import VERSION, EndLine, EventLine, encoded

PIPE_BYTES = 1 << 20
"""Size that is asked for a pipe: the most that Linux gives a user; a frame has about half of it."""

_LAST_S = 1.0
"""Longest wait for a slow reader, in seconds: once, when the run is over."""

_PAGES_BYTES = 8192
"""Bytes by which the room in a pipe can be less than its size less its contents: two pages that are not full."""


class EventStream:
    """The stream of one run: the configuration, then one line per event; use it as a context manager.

    A regular file receives everything. A pipe whose reader is slow loses whole frames first, then whole lines; the next
    line says how many. If the reader is gone or the disk is full, the stream ends with a warning and the run goes on.

    ``path``: a new file; or a FIFO, a terminal or ``/dev/fd/N``, which must exist. A FIFO needs no reader: what fits
    into it waits for one. ``frames``: whether the ADC counts of each frame follow its line.
    """

    def __init__(self, path: Path, configuration: Configuration, *, frames: bool = False) -> None:
        self.path = path
        self._frames = frames
        self._number = 0
        self._lost_lines = 0
        self._lost_frames = 0
        try:
            descriptor = _opened(path)
        except OSError as problem:
            raise RecordError(f"--events {path}: it cannot be written: {problem.strerror}; name another place") from (
                problem
            )
        mode = os.fstat(descriptor).st_mode
        self._regular = stat.S_ISREG(mode)
        self._pipe_bytes = _enlarged(descriptor) if stat.S_ISFIFO(mode) else None
        # Its buffer holds what a full pipe did not take. It is C code: a signal cannot part the two.
        self._file = io.BufferedWriter(io.FileIO(descriptor, "wb"), buffer_size=4 * PIPE_BYTES)
        known = json_values(configuration, what="the configuration")
        self._write(encoded({"stream": VERSION, "frames": frames, "configuration": known}))

    def add(self, event: JournalEvent, *, clock_s: float) -> None:
        """Send an event of a run that keeps no journal."""
        self._number += 1
        try:
            held = encode(event)
            row = held.row(self._number, clock_s=clock_s)
        except RecordError:
            # A number in it is not finite. A watcher must not end a run, so that the event counts as lost.
            self._lost_lines += 1
            return
        self.put(row, held.samples)

    def repeat(self, entries: Iterable[Entry]) -> None:
        """Send the entries of a journal that is resumed, without their frames."""
        for entry in entries:
            self.put(encode(entry.event).row(entry.number, clock_s=entry.clock_s, written=entry.written), None)

    def put(self, row: Row, samples: bytes | memoryview | None) -> None:
        """Send the row of an event, once it is committed; returns at once in any case.

        ``samples``: ADC counts of its frame; None where it has none, or none is to be sent.
        """
        if self._file.closed:
            return
        if not self._write():
            self._lost_lines += 1
            self._lost_frames += self._frames and samples is not None
            return
        frame = samples if self._frames and samples is not None else b""
        if frame and not self._has_room(len(frame) + len(row.body) + 1024):
            self._lost_frames += 1
            frame = b""
        line = EventLine(
            number=row.number,
            kind=row.kind,
            written=row.written,
            clock_s=row.clock_s,
            body=msgspec.Raw(row.body.encode()),
            frame_bytes=len(frame),
            lost_lines=self._lost_lines,
            lost_frames=self._lost_frames,
        )
        self._lost_lines, self._lost_frames = 0, 0
        self._write(encoded(line), frame)

    def close(self) -> None:
        """Send the end and close the file; waits up to a second for a slow reader, once the run is over."""
        if self._file.closed:
            return
        poller = select.poll()
        poller.register(self._file.fileno(), select.POLLOUT)
        if not self._write() and not self._file.closed:
            # A pipe is writable once its reader has taken a page; the buffer holds one line, which has less.
            poller.poll(_LAST_S * 1e3)
        if self._write():
            self._write(encoded(EndLine(end=True, lost_lines=self._lost_lines, lost_frames=self._lost_frames)))
        self._abandon()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, *parts: bytes | memoryview) -> bool:
        """Hand bytes to the pipe, behind what it has not taken yet; returns whether it has taken everything."""
        if self._file.closed:
            return False
        try:
            for part in parts:
                self._file.write(part)
            self._file.flush()
        except BlockingIOError:
            return False
        except OSError as problem:
            self._fail(problem)
            return False
        return True

    def _has_room(self, size_bytes: int) -> bool:
        """Whether so many bytes fit at once; assumed where the system does not say how full a pipe is."""
        if self._regular:
            return True
        if self._pipe_bytes is None:
            # What the pipe does not take must fit into the buffer.
            return size_bytes <= 4 * PIPE_BYTES
        (held,) = struct.unpack("i", fcntl.ioctl(self._file.fileno(), termios.FIONREAD, bytes(4)))
        return bool(size_bytes <= self._pipe_bytes - held - _PAGES_BYTES)

    def _fail(self, problem: OSError) -> None:
        self._abandon()
        reason = "nobody reads it any more" if isinstance(problem, BrokenPipeError) else problem.strerror
        warnings.warn(f"--events {self.path}: {reason}; the stream of events ends here, the run goes on", stacklevel=4)

    def _abandon(self) -> None:
        # The raw file: closing the buffer would try to write what is left in it.
        self._file.raw.close()


def _opened(path: Path) -> int:
    """File descriptor that never blocks on a pipe."""
    inherited = path.is_relative_to("/dev/fd")
    if path.is_fifo() and not inherited:
        # Also for reading: opening a FIFO for writing alone fails, or waits, until somebody reads it.
        return os.open(path, os.O_RDWR | os.O_NONBLOCK)
    if inherited or (path.exists() and not path.is_file()):
        # Opened again, so that O_NONBLOCK does not hold for the other processes that have this pipe.
        return os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_APPEND)
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)


def _enlarged(descriptor: int) -> int | None:
    """Size of a pipe in bytes, once it is as large as the system allows; None where the system does not say."""
    if not hasattr(fcntl, "F_SETPIPE_SZ"):
        return None
    try:
        return fcntl.fcntl(descriptor, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    except OSError:
        # A user with many pipes is given no larger ones.
        return fcntl.fcntl(descriptor, fcntl.F_GETPIPE_SZ)
