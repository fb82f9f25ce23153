"""Lines to emulated devices: a port in the same process, a pseudo-terminal, and the faults of a serial line."""

from __future__ import annotations

import os
import select
import tty
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np

from markerseek._closing import Closing
from markerseek.core import Clock, ConfigError, NotConnectedError
from markerseek.sim import Fault

_POLL_S = 1e-3
"""Time between two polls of an emulator in the same process while a reader waits, in seconds."""

_UNREAD_LIMIT = 65536
"""Most bytes kept for a driver that does not read; later ones are lost, as on a wire."""


class ByteDevice(Protocol):
    """An emulated device, without a line or a clock of its own."""

    def advance(self, now_s: float) -> bytes:
        """Advance the device to that time of the clock, and return the bytes that it sends by itself until then."""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes now, and return the immediate answer."""


class DirectPort:
    """A `markerseek.wire.port.Port` that ends at an emulator in the same process.

    Waiting for bytes is waiting on the clock, so that with a virtual clock nothing takes real time.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._inbox = bytearray()
        self._open = True

    def write(self, data: bytes) -> None:
        """As `Port.write`; the line is gone when it was closed."""
        # Advance first: the device must be at the present time when it receives a command.
        self._poll()
        self._inbox += self._device.feed(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As `Port.read`."""
        ends_s = self._clock.now_s() + timeout_s
        self._poll()
        while len(self._inbox) < size and (left_s := ends_s - self._clock.now_s()) > 0:
            self._clock.wait(min(_POLL_S, left_s))
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


class PtyLine(Closing):
    """A pseudo-terminal pair: drivers open `path`, the emulator answers at the other end.

    Use it as a context manager, and call `serve_once` again and again, in a thread or a process of its own.

    ``clock``: its clock: real time, where another program is at the other end. ``link``: path of a link to the
    pseudo-terminal, whose own name changes from start to start; None: no link.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock, link: Path | None = None) -> None:
        self._device = device
        self._clock = clock
        self._outbox = bytearray()
        self._link: Path | None = None
        self._ours, self._theirs = os.openpty()
        # Our copy of the driver's end stays open: without it, reading fails whenever no driver has the port open.
        # Raw: a terminal would echo the driver's bytes and change line ends.
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self._open = True
        self._name = os.ttyname(self._theirs)
        if link is not None:
            self._put_link(link)

    @property
    def path(self) -> str:
        """Name of the serial port for a driver."""
        return str(self._link or self._name)

    def serve_once(self, *, wait_s: float) -> None:
        """Wait for bytes at most that many seconds, then advance the device once."""
        arrived, _, _ = select.select([self._ours], [], [], wait_s)
        # Read first: bytes that arrive after the time is taken would be answered as of a time before they were sent.
        data = os.read(self._ours, 4096) if arrived else b""
        self._outbox += self._device.advance(self._clock.now_s())
        if data:
            self._outbox += self._device.feed(data)
        # A full pty would block the loop that serves the other devices too.
        del self._outbox[_UNREAD_LIMIT:]
        if self._outbox:
            try:
                del self._outbox[: os.write(self._ours, self._outbox)]
            except BlockingIOError:
                return

    def close(self) -> None:
        """Close the line; a driver that has it open is disconnected. Allowed twice."""
        if not self._open:
            return
        self._open = False
        os.close(self._ours)
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _put_link(self, link: Path) -> None:
        try:
            link.symlink_to(self._name)
        except OSError as error:
            self.close()
            raise ConfigError(
                f"link: {link} cannot be made a link to {self._name} ({error.strerror}); "
                "name another path, or delete what a killed emulator left there"
            ) from error
        self._link = link


class FaultyLine:
    """Passes bytes to and from a device, changed by the faults that hold.

    ``fault``: returns the fault of that name if it holds now.
    """

    def __init__(self, *, fault: Callable[[str], Fault | None], rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._late: deque[tuple[float, bytes]] = deque()

    def to_device(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the device."""
        if self._cut(now_s):
            return b""
        return self._garbled(self._thinned(data), "garbled commands")

    def to_host(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the host now when the device sends these."""
        if self._cut(now_s):
            self._late.clear()
            return b""
        data = self._garbled(self._thinned(data), "garbled answers")
        late = self._fault("late answers")
        if late is not None:
            if data:
                self._late.append((now_s + late.amount, data))
            data = b""
        # In order of sending: a serial line delays bytes, and never reorders them.
        due = bytearray()
        while self._late and self._late[0][0] <= now_s:
            due += self._late.popleft()[1]
        return bytes(due) + data

    def _cut(self, now_s: float) -> bool:
        if self._fault("silent") is not None or self._fault("power cut") is not None:
            return True
        drop_outs = self._fault("drop-outs")
        return drop_outs is not None and now_s % 1.0 < drop_outs.amount

    def _thinned(self, data: bytes) -> bytes:
        lost = self._fault("lost bytes")
        if lost is None or not data:
            return data
        kept = self._rng.random(len(data)) >= lost.amount
        return bytes(byte for byte, keep in zip(data, kept, strict=True) if keep)

    def _garbled(self, data: bytes, name: str) -> bytes:
        garbled = self._fault(name)
        if garbled is None or not data:
            return data
        hit = self._rng.random(len(data)) < garbled.amount
        # One bit of a byte: the fault that a form without a checksum is least able to detect.
        flips = np.where(hit, 1 << self._rng.integers(0, 8, len(data)), 0)
        return bytes(byte ^ int(flip) for byte, flip in zip(data, flips, strict=True))
