"""Opens a serial port: 8 data bits, 1 stop bit, locked against other programs. Only this file uses pyserial."""

from __future__ import annotations

import termios
from typing import Any, Literal, TypeAlias

from markerseek.core import NotConnectedError, needs_package

Parity: TypeAlias = Literal["N", "E", "O"]
"""Parity bit: none, even or odd."""

SERIAL_ERRORS = (OSError, termios.error)
"""Errors of a line that has been unplugged: pyserial's are OSErrors, a broken pseudo-terminal gives termios.error."""


def open_serial(path: str, *, baud: int, parity: Parity, write_timeout_s: float, rtscts: bool = False) -> Any:
    """Serial port as an object of pyserial; reads return at once.

    ``baud``: bits per second. ``write_timeout_s``: longest time that a write may block; 0: never. ``rtscts``: whether
    to use RTS/CTS flow control. Raises `NotConnectedError` if the port cannot be opened, or another program holds it.
    """
    with needs_package("pyserial", extra="devices", purpose="a serial port"):
        import serial  # type: ignore[import-untyped, unused-ignore]
    try:
        return serial.Serial(
            port=path,
            baudrate=baud,
            parity=parity,
            rtscts=rtscts,
            # Drivers wait by their own clock, which also renews the supervisor's lease.
            timeout=0,
            write_timeout=write_timeout_s,
            # Two programs on one line would each receive a part of the answers.
            exclusive=True,
        )
    except (*SERIAL_ERRORS, ValueError) as error:
        raise NotConnectedError(
            f"serial port {path} cannot be opened ({error}); plug the device in, switch it on, and close "
            "other programs that use it"
        ) from error
