"""A stage behind a busy computer, in virtual time: host, relay and device are each held up at random moments."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from markerseek.emulators import ByteDevice
from markerseek.sim import VirtualClock

_TICK_S = 2e-3


class Delays:
    """How long a process is held up: at a share of its steps, by any time up to a longest one."""

    def __init__(self, *, rng: np.random.Generator, share: float, most_s: float) -> None:
        self._rng = rng
        self._share = share
        self._most_s = most_s

    def draw_s(self) -> float:
        """Delay of the next step, in seconds."""
        return float(self._rng.uniform(0.0, self._most_s)) if self._rng.random() < self._share else 0.0


class DelayedClock(VirtualClock):
    """Time of a host that may be held up whenever it looks at the clock, and after each wait."""

    def __init__(self, delays: Delays) -> None:
        super().__init__()
        self._delays = delays

    def now_s(self) -> float:
        self._now_s += self._delays.draw_s()
        return super().now_s()

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s + self._delays.draw_s())


class DelayedPort:
    """A line with a relay to a device that a process of its own serves, as `PtyLine` does; both are held up."""

    def __init__(self, *, device: ByteDevice, clock: VirtualClock, delays: Delays) -> None:
        self._device = device
        self._clock = clock
        self._delays = delays
        self._down: deque[tuple[float, bytes]] = deque()
        self._up: deque[tuple[float, bytes]] = deque()
        self._server = self._serve(clock.now_s())
        self._resumes_s = next(self._server)

    def write(self, data: bytes) -> None:
        now_s = self._catch_up()
        self._send(self._down, data, now_s)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        assert timeout_s == 0, "the driver waits on its clock"
        now_s = self._catch_up()
        return self._arrived(self._up, now_s)[:size]

    def close(self) -> None:
        pass

    def _catch_up(self) -> float:
        """Let the device's process run until now."""
        now_s = self._clock.now_s()
        while self._resumes_s <= now_s:
            self._resumes_s = next(self._server)
        return now_s

    def _serve(self, now_s: float) -> Iterator[float]:
        """Each turn of `PtyLine.serve_once`; yields when its process goes on."""
        while True:
            now_s += _TICK_S + self._delays.draw_s()
            yield now_s
            data = self._arrived(self._down, now_s)
            now_s += self._delays.draw_s()
            yield now_s
            said = self._device.advance(now_s) + (self._device.feed(data) if data else b"")
            now_s += self._delays.draw_s()
            yield now_s
            if said:
                self._send(self._up, said, now_s)

    def _send(self, way: deque[tuple[float, bytes]], data: bytes, now_s: float) -> None:
        """What was sent later never arrives earlier."""
        due_s = now_s + self._delays.draw_s()
        way.append((max(due_s, way[-1][0]) if way else due_s, data))

    def _arrived(self, way: deque[tuple[float, bytes]], now_s: float) -> bytes:
        data = b""
        while way and way[0][0] <= now_s:
            data += way.popleft()[1]
        return data
