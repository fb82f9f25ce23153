"""The serial lines that the supervisor holds, and how they are opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from markerseek.core import ConfigError, NotConnectedError, require_range
from markerseek.files import Parity, open_serial


class OpenLine(Protocol):
    """What the supervisor needs of an open line."""

    def fileno(self) -> int:
        """Its file descriptor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A serial line, and the command that makes its device safe."""

    name: str
    """Its name in this rig."""
    path: str
    safe_command: bytes
    """Message that takes the laser's permit away, or stops the stage; valid at any time, also twice."""
    baud: int = 115200
    parity: Parity = "N"
    rtscts: bool = False
    """``baud``, ``parity`` and ``rtscts``: how it is opened: 8 data bits, 1 stop bit; ``rtscts`` for the handshake by
    two wires."""

    def __post_init__(self) -> None:
        if not self.safe_command:
            raise ConfigError(f"line {self.name!r}: safe_command is empty; give the command that makes the device safe")
        require_range(f"line {self.name!r}: baud", self.baud, low=1200, high=4_000_000)


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
