"""A trace: what devices and markerseek say to each other, with its time, in a file of one line each.

The trace is Python's `logging`: each package logs under its own name at the level DEBUG, and a trace is a handler that
writes these records to a file. A program of one's own gets the same by ``logging.getLogger("markerseek")``.
"""

from __future__ import annotations

import logging
import os
import platform
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from markerseek._version import __version__
from markerseek.core import ConfigError
from markerseek.files import open_for_writing
from markerseek.wire import Port

_LOG = logging.getLogger(__name__)
_ALL = logging.getLogger("markerseek")

_TEXT = frozenset(range(0x20, 0x7F)) | {0x09, 0x0A, 0x0D}
"""Bytes of a text protocol."""


def readable(data: bytes) -> str:
    """Return bytes as people read them: text in quotes, or hexadecimal numbers."""
    if _TEXT.issuperset(data):
        return repr(data.decode("ascii"))
    return data.hex(" ")


class TracedPort:
    """A `markerseek.wire.Port` that logs what is written to another one, and what is read from it.

    ``name``: of its device, in each line.
    """

    def __init__(self, port: Port, name: str) -> None:
        self._port = port
        self._name = name

    def write(self, data: bytes) -> None:
        """As `Port.write`; logged before it is sent, so that a line that is lost is in the trace."""
        _LOG.debug("%s > %s", self._name, readable(data))
        self._port.write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As `Port.read`; nothing is logged where nothing came."""
        data = self._port.read(size, timeout_s=timeout_s)
        if data:
            _LOG.debug("%s < %s", self._name, readable(data))
        return data

    def close(self) -> None:
        """Close the line; allowed twice."""
        self._port.close()


def traced(port: Port, name: str) -> Port:
    """Return the port, which logs its bytes where somebody reads the log."""
    return TracedPort(port, name) if _LOG.isEnabledFor(logging.DEBUG) else port


class _Lines(logging.Formatter):
    """A line for each record: monotonic time in seconds, package, message."""

    def format(self, record: logging.LogRecord) -> str:
        name = record.name.removeprefix("markerseek.")
        message = record.getMessage().replace("\n", " ")
        return f"{time.monotonic():14.6f}  {name:26} {message}"


class _File(logging.Handler):
    """Appends records to an open file; where that fails it says so, and writes no more: the run goes on."""

    def __init__(self, path: Path, descriptor: int) -> None:
        super().__init__()
        self._path = path
        self._descriptor = descriptor
        self._failed = False
        self.setFormatter(_Lines())

    def write(self, line: str) -> None:
        """Write a line; `OSError` if the system refuses it."""
        data = f"{line}\n".encode("utf-8", "backslashreplace")
        while data:
            data = data[os.write(self._descriptor, data) :]

    def emit(self, record: logging.LogRecord) -> None:
        """Write the line of a record."""
        if self._failed:
            return
        try:
            self.write(self.format(record))
        except OSError as problem:
            self._failed = True
            # This handler gets it as well, and passes over it.
            _LOG.warning(
                "%s: the trace ends here, it cannot be written: %s; name a file on another disk",
                self._path,
                problem.strerror,
            )


@contextmanager
def trace_to(path: Path) -> Iterator[None]:
    """Append what the packages log to a file, until the end of the block.

    Raises `ConfigError` if the file cannot be written, `RecordError` if it is a link.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds")
    with ExitStack() as stack:
        try:
            descriptor = open_for_writing(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, mode=0o600)
            stack.callback(os.close, descriptor)
            file = _File(path, descriptor)
            file.write(
                f"# trace of markerseek {__version__}, Python {platform.python_version()}, {platform.platform()}; "
                f"{now} is {time.monotonic():.6f} s of the monotonic clock"
            )
        except OSError as problem:
            raise ConfigError(
                f"{path}: the trace cannot be written: {problem.strerror}; name another file"
            ) from problem
        stack.callback(_ALL.setLevel, _ALL.level)
        stack.callback(_ALL.removeHandler, file)
        _ALL.addHandler(file)
        _ALL.setLevel(logging.DEBUG)
        yield
