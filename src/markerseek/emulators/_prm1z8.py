"""Mechanics of an emulated PRM1Z8: motor, encoder, backlash, and the probe that it turns."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from markerseek.emulators._motor import Motor
from markerseek.sim import Fault
from markerseek.wire import COUNTS_PER_DEG


class Turned(Protocol):
    """The true angle of the probe, as in `markerseek.sim.SimulatedWorld`."""

    angle_deg: float


class Prm1z8:
    """A motor with an encoder, and a probe that it turns with some backlash.

    Angles of the motor are the stage's own, counted from its home; the probe's are the world's.

    Parameters
    ----------
    probe
        The probe that is turned.
    zero_deg
        Angle of the motor at which the probe points at 0, in degrees.
    play_deg
        Backlash between motor and probe, in degrees: after an upward move the probe is at the motor's angle, after a
        downward move it lags by the backlash.
    sense
        1 if the probe turns as the motor does, -1 if it is mounted the other way round, the backlash included.
    fault
        Returns the fault of that name if it holds now.
    rng
        Source of randomness, for faults that need it.
    """

    def __init__(
        self,
        *,
        probe: Turned,
        zero_deg: float,
        play_deg: float,
        sense: int,
        fault: Callable[[str], Fault | None],
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
        self._slipped_deg = 0.0
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
        if motor.at_rest and self._fault("slip") is None:
            return False
        motor.lowest_deg, motor.highest_deg = math.inf, -math.inf
        turning = not motor.at_rest
        stopped = motor.advance(duration_s)
        if turning:
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
        slip, scale, play = self._fault("slip"), self._fault("scale"), self._fault("more play")
        pushed_deg = motor_deg - self._zero_deg
        if scale is not None:
            pushed_deg *= 1 + scale.amount
        if slip is not None:
            pushed_deg += slip.amount
        play_deg = self._play_deg if play is None else play.amount
        # The probe moves only when one side of the gap pushes it: clamp it to the gap, in the motor's direction.
        angle_deg = self._sense * min(max(self._sense * self._probe.angle_deg, pushed_deg), pushed_deg + play_deg)
        self._probe.angle_deg = angle_deg
        self.lowest_deg = min(self.lowest_deg, angle_deg)
        self.highest_deg = max(self.highest_deg, angle_deg)
