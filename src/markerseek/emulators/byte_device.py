"""What an emulator is to the line that it hangs on, and the shortest such line."""

from __future__ import annotations

from typing import Protocol

from markerseek.core import Clock, NotConnectedError


class ByteDevice(Protocol):
    """An emulated device, which knows no line and no clock of its own."""

    def advance(self, now_s: float) -> bytes:
        """Let time go by until that moment of the clock, and return what the device says by itself meanwhile."""

    def feed(self, data: bytes) -> bytes:
        """Take in bytes, now, and return what the device answers at once."""


class DirectPort:
    """A `markerseek.wire.port.Port` that ends at an emulator in the same process.

    Waiting for bytes is waiting on the clock, so that with a virtual clock nothing takes real time.

    Parameters
    ----------
    device
        The emulator.
    clock
        Whose time both ends live in.
    step_s
        How often the device is looked at while a reader waits, in seconds.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock, step_s: float = 1e-3) -> None:
        self._device = device
        self._clock = clock
        self._step_s = step_s
        self._inbox = bytearray()
        self._open = True

    def write(self, data: bytes) -> None:
        """Hand bytes to the device.

        Raises
        ------
        NotConnectedError
            If the port was closed.
        """
        self._listen()
        self._inbox += self._device.feed(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to that many bytes; fewer, perhaps none, once the time has gone by.

        Raises
        ------
        NotConnectedError
            If the port was closed.
        """
        ends_s = self._clock.now_s() + timeout_s
        self._listen()
        while len(self._inbox) < size and (left_s := ends_s - self._clock.now_s()) > 0:
            self._clock.wait(min(self._step_s, left_s))
            self._listen()
        data = bytes(self._inbox[:size])
        del self._inbox[:size]
        return data

    def close(self) -> None:
        """Let go of the device; allowed twice."""
        self._open = False

    def _listen(self) -> None:
        if not self._open:
            raise NotConnectedError("the port was closed; open it again")
        self._inbox += self._device.advance(self._clock.now_s())
