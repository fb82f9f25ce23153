"""A serial port as a stream of bytes, locked against other programs; and what came on it that was no answer."""

from __future__ import annotations

from markerseek._closing import Closing
from markerseek.core import ConfigError, NotConnectedError, require_range
from markerseek.files import SERIAL_ERRORS, Parity, open_serial

_WRITE_TIMEOUT_S = 0.5
"""A line that accepts no bytes for that long counts as gone."""


class SerialPort(Closing):
    """A `markerseek.wire.Port` over pyserial, under an exclusive lock.

    ``baud``: bits per second. ``parity``: parity bit: none, even or odd. ``handshake``: whether RTS and CTS control the
    flow; ignored where the port has no such lines, as a pseudo-terminal. Raises `NotConnectedError` if the port cannot
    be opened, or another program has it open.
    """

    def __init__(self, path: str, *, baud: int = 115200, parity: Parity = "N", handshake: bool = False) -> None:
        if not path:
            raise ConfigError("serial port: path is empty; name the port, for instance /dev/ttyUSB0")
        require_range("serial port: baud", baud, low=300, high=4_000_000, unit="bits per second")
        self._path = path
        self._line = open_serial(path, baud=baud, parity=parity, write_timeout_s=_WRITE_TIMEOUT_S)
        if handshake:
            self._shake_hands()

    def write(self, data: bytes) -> None:
        """As `Port.write`; a line that accepts no bytes is gone too."""
        try:
            sent = self._line.write(data)
        except SERIAL_ERRORS as error:
            raise self._gone() from error
        # A device that got half a command would take the next one for its other half.
        if sent != len(data):
            raise self._gone()

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As `Port.read`."""
        try:
            self._line.timeout = timeout_s
            return bytes(self._line.read(size))
        except SERIAL_ERRORS as error:
            raise self._gone() from error

    def close(self) -> None:
        """Close the line; allowed twice."""
        self._line.close()

    def _shake_hands(self) -> None:
        # Set after opening: a port without these lines refuses them, and would otherwise not open at all.
        try:
            self._line.rts = True
            self._line.rtscts = True
        except SERIAL_ERRORS:
            self._line.rtscts = False

    def _gone(self) -> NotConnectedError:
        return NotConnectedError(f"serial port {self._path} is gone; check the cable and the device's power")


_SHOWN = 16

ANOTHER_PROGRAM = (
    "does another program write on this line? ModemManager asks each new port whether it is a modem; end it by "
    "systemctl stop ModemManager"
)
"""Question and cure where bytes do not fit."""


class Unread:
    """Bytes since the last question."""

    def __init__(self) -> None:
        self._count = 0
        self._first = b""

    def clear(self) -> None:
        """Forget them: a question is asked, or was answered."""
        self._count = 0
        self._first = b""

    def add(self, data: bytes) -> None:
        """Note what came."""
        self._count += len(data)
        self._first += data[: _SHOWN - len(self._first)]

    def said(self, *, cure: str) -> str:
        """Return the end of an error: how many bytes came and the first of them, and what to do.

        ``cure``: what to do where none came.
        """
        if not self._count:
            return f"no byte came; {cure}"
        text = "".join(chr(byte) if 32 <= byte < 127 else "." for byte in self._first)
        return (
            f"{self._count} bytes came that are no answer, the first: {self._first.hex(' ')} ({text!r}); are the ports "
            "of stage and laser exchanged, or is it another device, firmware or speed of the line? Or "
            f"{ANOTHER_PROGRAM}"
        )
