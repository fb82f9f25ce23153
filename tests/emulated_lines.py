"""Lines to emulated devices in the same process, in virtual time, and what a serial line does to bytes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from markerseek.core import Clock, NotConnectedError, Permit
from markerseek.emulators import ByteDevice
from markerseek.sim import VirtualClock

_POLL_S = 1e-3


def permit(token: str = "a", *, pulses: int = 4, expires_s: float = math.inf) -> Permit:
    """A permit at 0 degrees."""
    return Permit(token=token, angle_deg=0.0, pulses=pulses, expires_s=expires_s)


@dataclass(kw_only=True)
class FaultyLine:
    """A line that delays, loses and garbles bytes, by its amounts, once `holds` is true."""

    late_s: float | tuple[float, float] = 0.0
    """Delay of the answers, or its least and largest."""
    cut: float = 0.0
    """Share of every second in which nothing comes through."""
    lost: float = 0.0
    """Share of the bytes that are lost, both ways."""
    answers: float = 0.0
    """Share of the bytes of answers in which a bit is flipped."""
    commands: float = 0.0
    """The same of the commands."""
    holds: Callable[[], bool] = lambda: True
    seed: int = 0
    _late: deque[tuple[float, bytes]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self._rng = np.random.Generator(np.random.PCG64(self.seed))

    def to_device(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the device."""
        if not self.holds():
            return data
        return b"" if now_s % 1.0 < self.cut else self._garbled(data, self.commands)

    def to_host(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the host now when the device sends these."""
        if not self.holds():
            return data
        if now_s % 1.0 < self.cut:
            return b""
        # In order of sending: a serial line delays bytes, and never reorders them.
        if data:
            late_s = self._rng.uniform(*self.late_s) if isinstance(self.late_s, tuple) else self.late_s
            before_s = self._late[-1][0] if self._late else 0.0
            self._late.append((max(before_s, now_s + late_s), self._garbled(data, self.answers)))
        due = bytearray()
        while self._late and self._late[0][0] <= now_s:
            due += self._late.popleft()[1]
        return bytes(due)

    def _garbled(self, data: bytes, share: float) -> bytes:
        kept = [byte for byte in data if self.lost == 0 or self._rng.random() >= self.lost]
        # One bit of a byte: the fault that a form without a checksum is least able to detect.
        return bytes(
            byte ^ (1 << int(self._rng.integers(0, 8))) if share > 0 and self._rng.random() < share else byte
            for byte in kept
        )


class DirectPort:
    """A `markerseek.wire.Port` that ends at an emulator in the same process: waiting is waiting on the clock."""

    def __init__(self, *, device: ByteDevice, clock: Clock, line: FaultyLine | None = None) -> None:
        self.line = line or FaultyLine()
        self._device = device
        self._clock = clock
        self._inbox = bytearray()
        self._open = True

    def write(self, data: bytes) -> None:
        """As `Port.write`; the line is gone when it was closed."""
        # Advance first: the device must be at the present time when it receives a command.
        self._poll()
        now_s = self._clock.now_s()
        self._inbox += self.line.to_host(self._device.feed(self.line.to_device(data, now_s=now_s)), now_s=now_s)

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
        now_s = self._clock.now_s()
        self._inbox += self.line.to_host(self._device.advance(now_s), now_s=now_s)


class BenchClock(VirtualClock):
    """Virtual time that advances the emulated devices tick by tick during a wait."""

    def __init__(self, *, tick_s: float = 0.01) -> None:
        super().__init__()
        self._tick_s = tick_s
        self._followers: list[Callable[[float], object]] = []

    def lead(self, *followers: Callable[[float], object]) -> None:
        """Call these with the time at each tick, in this order."""
        self._followers += followers

    def wait(self, duration_s: float) -> None:
        """Advance the time in ticks."""
        assert 0 <= duration_s < math.inf
        ends_s = self.now_s() + duration_s
        while (left_s := ends_s - self.now_s()) > 0:
            super().wait(min(self._tick_s, left_s))
            # The order is kept: the laser box lights the world before the data acquisition reads it.
            for follower in self._followers:
                follower(self.now_s())
