"""A busy computer in virtual time: it holds up the host, the relay and the process of the emulators, anywhere."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from markerseek.core import Clock
from markerseek.emulators import ByteDevice
from markerseek.emulators.bench import ServingClock
from markerseek.sim import VirtualClock

_TICK_S = 2e-3
_POLL_S = 1e-3
_WAKE_S = 50e-6
"""Time from bytes on a line to the process that waits for them, on a computer that is not busy."""


class Delays:
    """How long a process is held up: at a share of its steps, by any time up to a longest one."""

    def __init__(self, *, rng: np.random.Generator, share: float, most_s: float) -> None:
        self._rng = rng
        self.share = share
        self._most_s = most_s

    def draw_s(self) -> float:
        """Delay of the next step, in seconds."""
        if not self.share:
            return 0.0
        return float(self._rng.uniform(0.0, self._most_s)) if self._rng.random() < self.share else 0.0


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


class DelayedBench:
    """The process that serves emulated devices, as `markerseek.emulators.bench.serve_bench` does, behind a relay.

    ``clock``: the host's. ``delays``: of the relay and of this process.
    """

    def __init__(self, *, clock: VirtualClock, delays: Delays) -> None:
        self.clock = clock
        self.delays = delays
        self.served_s = clock.now_s()
        """Time at which a device was served last."""
        self._ports: list[DelayedPort] = []
        self._awaited: DelayedPort | None = None
        self._resumes_s = self.served_s
        self._process = self._run()

    def port(self, device: ByteDevice, *, without_pauses: bool = False) -> DelayedPort:
        """A line to a device; ``without_pauses``: its time leaves out those of the process, as a laser box's does."""
        port = DelayedPort(self, device, clock=ServingClock(self) if without_pauses else self)
        self._ports.append(port)
        return port

    def now_s(self) -> float:
        """Time at which this process serves a device."""
        return self.served_s

    def wait(self, duration_s: float) -> None:
        """Never called: no device waits."""
        raise AssertionError(duration_s)

    def catch_up(self) -> float:
        """Let the process run until the host's present time, and return that."""
        now_s = self.clock.now_s()
        while self._resumes_s <= now_s:
            self._resumes_s = next(self._process)
        return now_s

    def wake(self, port: DelayedPort, due_s: float) -> None:
        """Bytes come to a line then; the process may wait for them."""
        if self._awaited is port:
            self._resumes_s = min(self._resumes_s, due_s + _WAKE_S + self.delays.draw_s())

    def _run(self) -> Iterator[float]:
        """Each turn of `PtyLine.serve_once`; yields when the process goes on."""
        while True:
            for port in self._ports:
                self._awaited = port
                until_s = min(self._resumes_s + _TICK_S / len(self._ports), port.due_s + _WAKE_S)
                yield max(until_s, self._resumes_s) + self.delays.draw_s()
                self._awaited = None
                data = port.arrived(self._resumes_s)
                yield self._resumes_s + self.delays.draw_s()
                self.served_s = self._resumes_s
                said = port.served(data)
                yield self._resumes_s + self.delays.draw_s()
                port.answer(said, self._resumes_s)


class DelayedPort:
    """A `markerseek.wire.Port` to a device of a `DelayedBench`; what was sent later never arrives earlier."""

    def __init__(self, bench: DelayedBench, device: ByteDevice, *, clock: Clock) -> None:
        self._bench = bench
        self._device = device
        self._clock = clock
        self._down: deque[tuple[float, bytes]] = deque()
        self._up: deque[tuple[float, bytes]] = deque()
        self._inbox = b""

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        self._send(self._down, data, self._bench.catch_up())
        self._bench.wake(self, self.due_s)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """As `Port.read`."""
        clock = self._bench.clock
        ends_s = clock.now_s() + timeout_s
        while True:
            self._inbox += _arrived(self._up, self._bench.catch_up())
            if len(self._inbox) >= size or not clock.now_s() < ends_s:
                data = self._inbox[:size]
                self._inbox = self._inbox[size:]
                return data
            clock.wait(_POLL_S)

    def close(self) -> None:
        """As `Port.close`."""

    @property
    def due_s(self) -> float:
        """When the next bytes come to the device."""
        return self._down[0][0] if self._down else math.inf

    def arrived(self, now_s: float) -> bytes:
        """Bytes that have come to the device by then."""
        return _arrived(self._down, now_s)

    def served(self, data: bytes) -> bytes:
        """What the device says, once by itself and once to these bytes."""
        return self._device.advance(self._clock.now_s()) + (self._device.feed(data) if data else b"")

    def answer(self, data: bytes, now_s: float) -> None:
        """Send what the device has said to the host."""
        if data:
            self._send(self._up, data, now_s)

    def _send(self, way: deque[tuple[float, bytes]], data: bytes, now_s: float) -> None:
        due_s = now_s + self._bench.delays.draw_s()
        way.append((max(due_s, way[-1][0]) if way else due_s, data))


def _arrived(way: deque[tuple[float, bytes]], now_s: float) -> bytes:
    data = b""
    while way and way[0][0] <= now_s:
        data += way.popleft()[1]
    return data
