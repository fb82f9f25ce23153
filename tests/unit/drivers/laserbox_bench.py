"""An emulated laser box, the world it lights and a driver on it, in virtual time, for tests."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from markerseek.core import FrameHeader, Permit, ReadingFrame
from markerseek.drivers import LaserBox, LaserBoxSettings
from markerseek.emulators.laserbox import EmulatedLaserBox
from markerseek.sim import Flash, VirtualClock
from markerseek.wire import laserbox as wire
from tests.emulated_lines import DirectPort


@dataclass
class Lit:
    """A simulated world that records the light that fell on it."""

    angle_deg: float = 3.0
    flashes: list[Flash] = field(default_factory=list)

    def flash(self, *, pulses: int, at_s: float) -> None:
        self.flashes.append(Flash(at_s=at_s, pulses=pulses, energy=1.0))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ReadingFrame:
        return ReadingFrame(header=header, intensity=0.0)


class Bench:
    """A box, its world, and a driver on it."""

    def __init__(self) -> None:
        self.world = Lit()
        self.triggers: list[int] = []
        self.box = EmulatedLaserBox(world=self.world, on_triggers=self.triggers.append)
        self.faults = self.box.faults
        self.clock = VirtualClock()
        self.port = DirectPort(device=self.box, clock=self.clock)

    def driver(self, *, rate_hz: float = 100.0) -> LaserBox:
        settings = LaserBoxSettings(port="", rate_hz=rate_hz)
        return LaserBox(port=self.port, clock=self.clock, settings=settings)

    def say(self, *messages: wire.Command, at_s: float | None = None) -> list[wire.Reply]:
        """Talk to the box without a driver."""
        replies = self.box.advance(self.clock.now_s() if at_s is None else at_s)
        for message in messages:
            replies += self.box.feed(wire.encode(message))
        return [wire.decode_reply(line) for line in replies.split(b"\n")[:-1]]


def permit(token: str = "a", *, pulses: int = 16, expires_s: float = math.inf) -> Permit:
    return Permit(token=token, angle_deg=3.0, pulses=pulses, expires_s=expires_s)


def pulses_of(token: int, *, pulses: int = 50, expiry_ms: int = 2000) -> wire.PermitPulses:
    return wire.PermitPulses(token=token, pulses=pulses, rate_hz=100, expiry_ms=expiry_ms, triggers=max(pulses, 1))
