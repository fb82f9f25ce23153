"""How the supervisor opens the serial lines that it holds."""

from __future__ import annotations

from typing import Protocol

from markerseek.core import NotConnectedError
from markerseek.files import Line, open_serial


class OpenLine(Protocol):
    """What the supervisor needs of an open line."""

    def fileno(self) -> int:
        """Its file descriptor."""


def open_line(line: Line) -> OpenLine:
    """The line, opened for this process alone, whose reads and writes never block.

    Raises `NotConnectedError` if it cannot be opened, or another program has it.
    """
    try:
        opened: OpenLine = open_serial(
            line.path, baud=line.baud, parity=line.parity, rtscts=line.rtscts, write_timeout_s=0
        )
    except NotConnectedError as error:
        raise NotConnectedError(f"line {line.name!r}: {error}") from None
    return opened
