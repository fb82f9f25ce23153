"""Protocol of an emulated device, and a port that connects one to a driver in the same process."""

from __future__ import annotations

from typing import Protocol

from markerseek.core import Clock, NotConnectedError


class ByteDevice(Protocol):
    """An emulated device, without a line or a clock of its own."""

    def advance(self, now_s: float) -> bytes:
        """Advance the device to that time of the clock, and return the bytes that it sends by itself until then."""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes now, and return the immediate answer."""


class DirectPort:
    """A `markerseek.wire.port.Port` that ends at an emulator in the same process.

    Waiting for bytes is waiting on the clock, so that with a virtual clock nothing takes real time.

    Parameters
    ----------
    device
        The emulator.
    clock
        Clock of both ends.
    step_s
        Time between two polls of the device while a reader waits, in seconds.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock, step_s: float = 1e-3) -> None:
        self._device = device
        self._clock = clock
        self._step_s = step_s
        self._inbox = bytearray()
        self._open = True

    def write(self, data: bytes) -> None:
        """Send bytes to the device.

        Raises
        ------
        NotConnectedError
            If the port was closed.
        """
        # Advance first: the device must be at the present time when it receives a command.
        self._poll()
        self._inbox += self._device.feed(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to that many bytes; fewer, perhaps none, after the timeout.

        Raises
        ------
        NotConnectedError
            If the port was closed.
        """
        ends_s = self._clock.now_s() + timeout_s
        self._poll()
        while len(self._inbox) < size and (left_s := ends_s - self._clock.now_s()) > 0:
            self._clock.wait(min(self._step_s, left_s))
            self._poll()
        data = bytes(self._inbox[:size])
        del self._inbox[:size]
        return data

    def close(self) -> None:
        """Close the port; allowed twice."""
        self._open = False

    def _poll(self) -> None:
        if not self._open:
            raise NotConnectedError("the port was closed; open it again")
        self._inbox += self._device.advance(self._clock.now_s())
