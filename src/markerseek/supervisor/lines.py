"""The lines that a supervisor holds, and how they are opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from markerseek.core import ConfigError, NotConnectedError
from markerseek.files import Parity, open_serial


class OpenLine(Protocol):
    """What the supervisor's loop needs of an open line."""

    def fileno(self) -> int:
        """Number of its file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A serial line, and the bytes that leave its device harmless.

    Attributes
    ----------
    name
        What it is called in this rig.
    path
        Device file.
    farewell
        Message that takes the laser's permit away, or stops the stage; understood at any time, also twice.
    baud, parity, rtscts
        How it is opened: 8 data bits, 1 stop bit; ``rtscts`` for the handshake by two wires.
    """

    name: str
    path: str
    farewell: bytes
    baud: int = 115200
    parity: Parity = "N"
    rtscts: bool = False

    def __post_init__(self) -> None:
        if not self.farewell:
            raise ConfigError(f"line {self.name!r}: farewell is empty; say what leaves the device harmless")
        if not 1200 <= self.baud <= 4_000_000:
            raise ConfigError(f"line {self.name!r}: baud is {self.baud}, it must lie in [1200, 4000000]")


def open_line(line: Line) -> OpenLine:
    """The line, opened for this process alone, whose reads and writes never block.

    Raises
    ------
    MissingExtraError
        If pyserial is not installed.
    NotConnectedError
        If it cannot be opened, or another program has it.
    """
    try:
        opened: OpenLine = open_serial(
            line.path, baud=line.baud, parity=line.parity, rtscts=line.rtscts, write_timeout_s=0
        )
    except NotConnectedError as error:
        raise NotConnectedError(f"line {line.name!r}: {error}") from None
    return opened
