"""The truth of a run: where the probe really was, what light really fell, and what could really be received."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import Frame, FrameHeader
from markerseek.sim import CurveWorld, Flash, VirtualClock


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light that really fell: when, how many pulses, where the probe was, and whether a move turned it."""

    at_s: float
    pulses: int
    angle_deg: float
    moving: bool


@dataclass(frozen=True, kw_only=True)
class Received:
    """What was really received under a token."""

    token: str
    intensity: float
    angle_deg: float
    pulses: int


class WatchedWorld:
    """A world whose truth is written down; the shaft between stage and probe may slip, or scale.

    ``angle_deg`` is what the stage turns, ``true_deg`` where the probe points.
    """

    def __init__(self, inner: CurveWorld, clock: VirtualClock) -> None:
        self._inner = inner
        self._clock = clock
        self._shaft_deg = inner.angle_deg
        self.slip_deg = 0.0
        self.scale = 1.0
        self.energy = 1.0
        self.moving = False
        self.lights: list[Light] = []
        self.received: list[Received] = []
        self.lowest_deg = self.highest_deg = inner.angle_deg
        self.flashes: list[Flash] = inner.flashes

    @property
    def angle_deg(self) -> float:
        return self._shaft_deg

    @angle_deg.setter
    def angle_deg(self, angle_deg: float) -> None:
        self._shaft_deg = angle_deg
        self.settle()

    @property
    def true_deg(self) -> float:
        return self._shaft_deg * self.scale + self.slip_deg

    def settle(self) -> None:
        """Write down where the probe is now."""
        self.lowest_deg = min(self.lowest_deg, self.true_deg)
        self.highest_deg = max(self.highest_deg, self.true_deg)

    def flash(self, *, pulses: int, at_s: float) -> None:
        self.lights.append(Light(at_s=at_s, pulses=pulses, angle_deg=self.true_deg, moving=self.moving))
        self._inner.flash(pulses=pulses, at_s=at_s)
        if self.energy != 1.0:
            last = self.flashes[-1]
            self.flashes[-1] = Flash(at_s=last.at_s, pulses=last.pulses, energy=last.energy * self.energy)

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> Frame:
        self._inner.angle_deg = self.true_deg
        frame = self._inner.frame(flash, header=header)
        self.received.append(
            Received(
                token=header.token,
                intensity=frame.intensity,
                angle_deg=self.true_deg,
                pulses=0 if flash is None else flash.pulses,
            )
        )
        return frame
