"""The emulated stage on a watched line in virtual time, for the tests of the stage's driver."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from markerseek.core import Interval, NotConnectedError
from markerseek.drivers import Kdc101Settings, Kdc101Stage
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire.apt import CONTROLLER, TO_CONTROLLER, AptFramer
from tests.emulated_lines import DirectPort

TRAVEL = Interval(low_deg=-36.5, high_deg=36.5)


class Killed(BaseException):
    """The program dies."""


class WatchedClock(VirtualClock):
    """Records the longest wait, and ends the program at a given moment."""

    def __init__(self) -> None:
        super().__init__()
        self.longest_s = 0.0
        self.killed_at_s = np.inf

    def wait(self, duration_s: float) -> None:
        self.longest_s = max(self.longest_s, duration_s)
        super().wait(duration_s)
        if self.now_s() >= self.killed_at_s:
            raise Killed


class WatchedPort(DirectPort):
    """Records the messages to the controller; can be cut, or set to drop a kind of message."""

    def __init__(self, **parts: Any) -> None:
        super().__init__(**parts)
        self.said: list[int] = []
        self.cut = False
        self.swallowed: int | None = None
        self.dead_from_s = np.inf
        self.angle_at_death_deg: float | None = None

    def write(self, data: bytes) -> None:
        if self.cut:
            raise NotConnectedError("cut")
        if self._clock.now_s() >= self.dead_from_s:
            if self.angle_at_death_deg is None:
                self.read(0, timeout_s=0.0)
                self.angle_at_death_deg = self._device._stage._probe.angle_deg  # type: ignore[attr-defined]
            return
        for message in AptFramer(TO_CONTROLLER, to=CONTROLLER).feed(data):
            self.said.append(message.ident)
            if message.ident != self.swallowed:
                super().write(message.raw)


def kdc101_stage(*, port: Any, clock: Any, **fields: Any) -> Kdc101Stage:
    """The driver with keys of a rig file, and a travel range, all by their names."""
    travel = fields.pop("travel", None)
    settings = Kdc101Settings(**{"port": "", "zero_deg": 0.0} | fields)
    return Kdc101Stage(port=port, clock=clock, settings=settings, travel=travel)


@dataclass
class Bench:
    clock: WatchedClock
    probe: SimpleNamespace
    emulator: Kdc101Emulator
    port: WatchedPort

    def stage(self, **fields: Any) -> Kdc101Stage:
        return kdc101_stage(port=self.port, clock=self.clock, **fields)

    def let_be(self, duration_s: float) -> None:
        self.clock.killed_at_s = np.inf
        self.clock.wait(duration_s)
        self.emulator.advance(self.clock.now_s())


def bench(*, start_deg: float = 0.0, **fields: Any) -> Bench:
    clock = WatchedClock()
    probe = SimpleNamespace(angle_deg=start_deg)
    emulator = Kdc101Emulator(probe=probe, settings=EmulatedKdc101(**fields))
    return Bench(clock, probe, emulator, WatchedPort(device=emulator, clock=clock))
