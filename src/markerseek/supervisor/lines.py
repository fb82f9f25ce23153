"""The lines that a supervisor holds, and how they are opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

from markerseek.core import ConfigError, MissingExtraError, NotConnectedError


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
    parity: Literal["N", "E", "O"] = "N"
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
        import serial  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise MissingExtraError(package="pyserial", extra="devices", purpose="a serial line") from None
    try:
        opened: OpenLine = serial.Serial(
            port=line.path,
            baudrate=line.baud,
            parity=line.parity,
            rtscts=line.rtscts,
            timeout=0,
            write_timeout=0,
            exclusive=True,
        )
    except (serial.SerialException, OSError, ValueError) as error:
        raise NotConnectedError(
            f"line {line.name!r}: {line.path} cannot be opened: {error}; "
            "is it plugged in, and used by no other program?"
        ) from None
    return opened
