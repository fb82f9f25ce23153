"""The truth of a run: where the probe really was, what light really fell, and what could really be received."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from markerseek.core import Frame, FrameHeader
from markerseek.sim import CurveWorld, Flash, VirtualClock


@dataclass(frozen=True, kw_only=True)
class Light:
    """Light that really fell: when, how many pulses, where the probe was, and whether a move or a sweep turned it."""

    at_s: float
    pulses: int
    angle_deg: float
    moving: bool
    sweeping: bool = False


@dataclass(frozen=True, kw_only=True)
class Received:
    """What was really received under a token."""

    token: str
    intensity: float
    angle_deg: float
    pulses: int


class WatchedWorld:
    """A world whose truth is written down; the shaft between stage and probe may slip, or scale.

    ``angle_deg`` is what the stage turns, ``true_deg`` where the probe points, ``shaft_at`` where the stage was at a
    time of its sweep.
    """

    def __init__(self, inner: CurveWorld, clock: VirtualClock) -> None:
        self._inner = inner
        self._clock = clock
        self._shaft_deg = inner.angle_deg
        self.slip_deg = 0.0
        self.scale = 1.0
        self.energy = 1.0
        self.moving = False
        self.shaft_at: Callable[[float], float] = lambda _at_s: self._shaft_deg
        self.lights: list[Light] = []
        self.received: list[Received] = []
        self.lowest_deg = inner.angle_deg
        self.highest_deg = self.lowest_deg
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
        return self._true_deg(self._shaft_deg)

    def _true_deg(self, shaft_deg: float) -> float:
        return shaft_deg * self.scale + self.slip_deg

    def true_at(self, at_s: float) -> float:
        """Where the probe points at a time of a sweep."""
        return self._true_deg(self.shaft_at(at_s))

    def settle(self) -> None:
        """Write down where the probe is now."""
        self.lowest_deg = min(self.lowest_deg, self.true_deg)
        self.highest_deg = max(self.highest_deg, self.true_deg)

    def flash(self, *, pulses: int, at_s: float) -> None:
        shaft_deg = self.shaft_at(at_s)
        self.lights.append(
            Light(
                at_s=at_s,
                pulses=pulses,
                angle_deg=self._true_deg(shaft_deg),
                moving=self.moving,
                sweeping=shaft_deg != self.shaft_at(at_s - 1e-3),
            )
        )
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
