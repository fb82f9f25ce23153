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
from contextlib import contextmanager
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


def shown(data: bytes) -> str:
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
        _LOG.debug("%s > %s", self._name, shown(data))
        self._port.write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As `Port.read`; nothing is logged where nothing came."""
        data = self._port.read(size, timeout_s=timeout_s)
        if data:
            _LOG.debug("%s < %s", self._name, shown(data))
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


@contextmanager
def trace_to(path: Path) -> Iterator[None]:
    """Append what the packages log to a file, until the end of the block.

    Raises `ConfigError` if the file cannot be written, `RecordError` if it is a link.
    """
    try:
        number = open_for_writing(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, mode=0o600)
    except OSError as problem:
        raise ConfigError(f"{path}: the trace cannot be written: {problem.strerror}; name another file") from problem
    with os.fdopen(number, "a", encoding="utf-8", errors="backslashreplace") as file:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        file.write(
            f"# trace of markerseek {__version__}, Python {platform.python_version()}, {platform.platform()}; {now} is "
            f"{time.monotonic():.6f} s of the monotonic clock\n"
        )
        handler = logging.StreamHandler(file)
        handler.setFormatter(_Lines())
        level = _ALL.level
        _ALL.addHandler(handler)
        _ALL.setLevel(logging.DEBUG)
        try:
            yield
        finally:
            _ALL.setLevel(level)
            _ALL.removeHandler(handler)
