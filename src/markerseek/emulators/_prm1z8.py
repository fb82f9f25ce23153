"""Mechanics of an emulated PRM1Z8: motor, encoder, backlash, and the probe that it turns. Pure, and exact in time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from markerseek.emulators.faults import Faults
from markerseek.sim import phases
from markerseek.wire.apt import COUNTS_PER_DEG

# Sums of phases miss a step's end by rounding; a remainder of this size is no time, and must not start a phase.
_NO_TIME_S = 1e-12


@dataclass(slots=True, kw_only=True)
class Motor:
    """A motor with trapezoidal speed, whose target may change during a move."""

    angle_deg: float
    target_deg: float
    speed_deg_s: float = 0.0
    """``angle_deg`` and ``speed_deg_s``: angle, and speed with its sign."""
    top_speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    """``top_speed_deg_s`` and ``acceleration_deg_s2``: largest speed, and acceleration."""
    low_deg: float = -math.inf
    high_deg: float = math.inf
    """``low_deg`` and ``high_deg``: angles at which it stops at once: a soft limit, or an obstacle."""
    lowest_deg: float = math.inf
    highest_deg: float = -math.inf
    """``lowest_deg`` and ``highest_deg``: smallest and largest angle that it has reached."""

    @property
    def at_rest(self) -> bool:
        """Whether it is at rest at its target."""
        return self.speed_deg_s == 0 and self.angle_deg == self.target_deg

    def halt(self) -> None:
        """Stop at once, and stay."""
        self.speed_deg_s = 0.0
        self.target_deg = self.angle_deg

    def advance(self, duration_s: float) -> bool:
        """Turn for that long; return whether it stopped at a limit."""
        left_s = duration_s
        self._note()
        for phase_s, acceleration in phases(
            self.target_deg - self.angle_deg,
            speed_deg_s=self.speed_deg_s,
            top_deg_s=self.top_speed_deg_s,
            acceleration_deg_s2=self.acceleration_deg_s2,
        ):
            step_s = min(phase_s, left_s)
            self.angle_deg += self.speed_deg_s * step_s + acceleration * step_s**2 / 2
            self.speed_deg_s += acceleration * step_s
            left_s -= step_s
            # Checked at the end of a phase only: within one the speed keeps its sign, so its end is the farthest point.
            if not self.low_deg <= self.angle_deg <= self.high_deg:
                self.angle_deg = min(max(self.angle_deg, self.low_deg), self.high_deg)
                self.halt()
                self._note()
                return True
            self._note()
            if left_s <= _NO_TIME_S:
                break
        if left_s > _NO_TIME_S or (abs(self.angle_deg - self.target_deg) < 1e-9 and abs(self.speed_deg_s) < 1e-6):
            self.angle_deg, self.speed_deg_s = self.target_deg, 0.0
            self._note()
        return False

    def _note(self) -> None:
        self.lowest_deg = min(self.lowest_deg, self.angle_deg)
        self.highest_deg = max(self.highest_deg, self.angle_deg)


class Turned(Protocol):
    """The true angle of the probe, as in `markerseek.sim.SimulatedWorld`."""

    angle_deg: float


class Prm1z8:
    """A motor with an encoder, and a probe that it turns with some backlash.

    Angles of the motor are the stage's own, counted from its home; the probe's are the world's.

    ``zero_deg``: angle of the motor at which the probe points at 0. ``play_deg``: backlash between motor and probe:
    after an upward move the probe is at the motor's angle, after a downward move it lags by the backlash. ``sense``: 1
    if the probe turns as the motor does, -1 if it is mounted the other way round, the backlash included. ``fault``:
    its faults.
    """

    def __init__(
        self,
        *,
        probe: Turned,
        zero_deg: float,
        play_deg: float,
        sense: int,
        fault: Faults,
        rng: np.random.Generator,
    ) -> None:
        start_deg = sense * probe.angle_deg + zero_deg
        self.motor = Motor(angle_deg=start_deg, target_deg=start_deg)
        self.lowest_deg = self.highest_deg = probe.angle_deg
        self.offset = 0
        self._probe = probe
        self._zero_deg = zero_deg
        self._play_deg = play_deg
        self._sense = sense
        self._fault = fault
        self._jumped = False
        self._rng = rng
        self._jumps_in_s: float | None = None

    @property
    def counts(self) -> int:
        """Value of the position counter."""
        return round(self.motor.angle_deg * COUNTS_PER_DEG) + self.offset

    def angle_of(self, counts: int) -> float:
        """Angle of the motor at which the position counter has that value, in degrees."""
        return (counts - self.offset) / COUNTS_PER_DEG

    def motor_angle_of(self, probe_deg: float) -> float:
        """Angle of the motor at which it pushes the probe to that angle, in degrees."""
        return self._sense * probe_deg + self._zero_deg

    def advance(self, duration_s: float) -> bool:
        """Turn for that long; return whether the motor stopped before its target."""
        motor = self.motor
        jump = self._fault("readback jump")
        if jump is not None and not self._jumped:
            self._jumped = True
            self.offset += round(jump.amount * COUNTS_PER_DEG)
        if motor.at_rest:
            return False
        motor.lowest_deg, motor.highest_deg = math.inf, -math.inf
        stopped = motor.advance(duration_s)
        self._jump_on_its_way(duration_s)
        # The limits are checked against the whole path of the motor, turning points included.
        for angle_deg in {motor.lowest_deg, motor.highest_deg} - {motor.angle_deg, math.inf, -math.inf}:
            self._turn_probe(angle_deg)
        self._turn_probe(motor.angle_deg)
        return stopped

    def _jump_on_its_way(self, turned_s: float) -> None:
        """Make the counter jump once, after the motor has turned for a random time with this fault."""
        jump = self._fault("jump on its way")
        if jump is None or self._jumps_in_s == -math.inf:
            return
        if self._jumps_in_s is None:
            self._jumps_in_s = self._rng.uniform(0.0, 1.0)
        self._jumps_in_s -= turned_s
        if self._jumps_in_s <= 0 and not self.motor.at_rest:
            self._jumps_in_s = -math.inf
            self.offset += round(jump.amount * COUNTS_PER_DEG)

    def _turn_probe(self, motor_deg: float) -> None:
        pushed_deg = motor_deg - self._zero_deg
        # The probe moves only when one side of the gap pushes it: clamp it to the gap, in the motor's direction.
        farthest_deg = pushed_deg + self._play_deg
        angle_deg = self._sense * min(max(self._sense * self._probe.angle_deg, pushed_deg), farthest_deg)
        self._probe.angle_deg = angle_deg
        self.lowest_deg = min(self.lowest_deg, angle_deg)
        self.highest_deg = max(self.highest_deg, angle_deg)
