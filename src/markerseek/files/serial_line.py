"""A serial line and how it is opened: 8 data bits, 1 stop bit, locked for one program. Only this file uses pyserial."""

from __future__ import annotations

import errno
import os
import termios
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from markerseek.core import ConfigError, NotConnectedError, Within, needs_package, require_fields

Parity: TypeAlias = Literal["N", "E", "O"]
"""Parity bit: none, even or odd."""

SERIAL_ERRORS = (OSError, termios.error)
"""Errors of an unplugged line: pyserial raises OSError, a broken pseudo-terminal raises termios.error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A serial line, and the command that makes its device safe."""

    name: str
    """Name of the line in the rig."""
    path: str
    """Device file, for example ``/dev/ttyUSB0``."""
    safe_command: bytes
    """Message that withdraws the laser's permit or stops the stage; it is valid at any time, also twice."""
    baud: Annotated[int, Within(1200, 4_000_000)] = 115200
    """Bits per second."""
    parity: Parity = "N"
    """Parity bit."""
    rtscts: bool = False
    """Whether the line uses RTS/CTS flow control."""

    def __post_init__(self) -> None:
        if not self.safe_command:
            raise ConfigError(f"line {self.name!r}: safe_command is empty; give the command that makes the device safe")
        require_fields(self, f"line {self.name!r}")


def pyserial() -> Any:
    """Return the module `serial`; `MissingExtraError` where the package pyserial is not installed."""
    with needs_package("pyserial", extra="devices", purpose="a serial port", module="serial"):
        import serial  # type: ignore[import-untyped, unused-ignore]
    return serial


def open_serial(path: str, *, baud: int, parity: Parity, write_timeout_s: float, rtscts: bool = False) -> Any:
    """Return the serial port as an object of pyserial; reads return at once.

    ``baud``: bits per second. ``write_timeout_s``: longest time that a write may block; 0: never. ``rtscts``: whether
    to use RTS/CTS flow control. Raises `NotConnectedError` if the port cannot be opened, or if another program uses it.
    """
    try:
        return pyserial().Serial(
            port=path,
            baudrate=baud,
            parity=parity,
            rtscts=rtscts,
            # Drivers wait on their own clock, which also renews the supervisor's lease.
            timeout=0,
            write_timeout=write_timeout_s,
            # Two programs on one line would each receive a part of the answers.
            exclusive=True,
        )
    except (*SERIAL_ERRORS, ValueError) as error:
        # pyserial's own message names the path again, and the reason twice.
        number = getattr(error, "errno", None)
        reason = str(error) if number is None else os.strerror(number)
        if number == errno.EAGAIN:
            reason = "another program holds it"
        cure = "plug the device in, switch it on, and close other programs that use it"
        if number == errno.EACCES:
            cure = (
                f"only the group {_group_of(path)} may open it: sudo usermod -aG {_group_of(path)} $USER, then log out "
                "and in again"
            )
        raise NotConnectedError(f"serial port {path} cannot be opened ({reason}); {cure}") from error


def _group_of(path: str) -> str:
    """Return the group that may open a port; dialout if it is not known."""
    with suppress(OSError, KeyError):
        if (name := Path(path).group()) != "root":
            return name
    return "dialout"
