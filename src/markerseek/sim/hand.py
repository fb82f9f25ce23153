"""A simulated hand that turns the probe: it overshoots, comes to rest beside the angle asked for, and drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import Clock, Interval
from markerseek.sim.world import SimulatedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class HandMotion:
    """How a hand turns the probe."""

    overshoot_deg: float = 2.0
    """How far it first goes beyond the angle asked for."""
    beside_deg: tuple[float, float] = (0.1, 0.8)
    """Least and largest distance at which it comes to rest."""
    turn_s: tuple[float, float] = (3.0, 8.0)
    """Least and largest duration of a turn."""
    drift_deg_s: float = 0.01
    """Speed at which it drifts afterwards, to either side."""
    resolution_deg: float = 0.01
    """Step of the encoder."""


class SimulatedHand:
    """Turns the world's probe, and reports its angle as an encoder does.

    ``limits``: it comes to rest inside.
    """

    emulated = True
    unused = ""

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        clock: Clock,
        limits: Interval,
        rng: np.random.Generator,
        motion: HandMotion | None = None,
    ) -> None:
        self._world, self._clock, self._limits, self._rng = world, clock, limits, rng
        self._motion = motion or HandMotion()
        # Moments in seconds, and the angle in degrees at each.
        self._times_s, self._angles_deg = np.array([clock.now_s()]), np.array([world.angle_deg])
        self._drift_deg_s = 0.0

    def turn_to(self, angle_deg: float) -> None:
        """Begin to turn the probe to an angle in degrees."""
        motion, here_deg, now_s = self._motion, self._now_deg(), self._clock.now_s()
        duration_s = self._rng.uniform(*motion.turn_s)
        side = self._rng.choice((-1.0, 1.0))
        reached_deg = angle_deg + side * self._rng.uniform(*motion.beside_deg)
        if reached_deg not in self._limits:
            reached_deg = 2 * angle_deg - reached_deg
        beyond_deg = angle_deg + np.sign(angle_deg - here_deg) * motion.overshoot_deg
        self._times_s = now_s + duration_s * np.array([0.0, 0.6, 1.0])
        self._angles_deg = np.array([here_deg, beyond_deg, reached_deg])
        self._drift_deg_s = self._rng.choice((-1.0, 1.0)) * motion.drift_deg_s

    def read(self) -> float:
        """Angle of the probe now, in steps of the encoder, in degrees."""
        self._world.angle_deg = self._now_deg()
        return round(self._world.angle_deg / self._motion.resolution_deg) * self._motion.resolution_deg

    def _now_deg(self) -> float:
        now_s = self._clock.now_s()
        drifted_deg = self._drift_deg_s * max(0.0, now_s - float(self._times_s[-1]))
        return float(np.interp(now_s, self._times_s, self._angles_deg)) + drifted_deg
