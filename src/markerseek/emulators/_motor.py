"""A motor with trapezoidal speed whose target may change during a move. Pure, and exact in time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

# Sums of phases miss a step's end by rounding; a remainder of this size is no time, and must not start a phase.
_NO_TIME_S = 1e-12


@dataclass(slots=True, kw_only=True)
class Motor:
    """State of a motor: angle, speed, target and the range that it has covered.

    Attributes
    ----------
    angle_deg, speed_deg_s
        Angle, and speed with its sign.
    target_deg
        Target of the move.
    top_speed_deg_s, acceleration_deg_s2
        Largest speed, and acceleration.
    low_deg, high_deg
        Angles at which it stops at once: a soft limit, or an obstacle.
    lowest_deg, highest_deg
        Smallest and largest angle that it has reached.
    """

    angle_deg: float
    target_deg: float
    speed_deg_s: float = 0.0
    top_speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    low_deg: float = -math.inf
    high_deg: float = math.inf
    lowest_deg: float = math.inf
    highest_deg: float = -math.inf

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
        for phase_s, acceleration in self._phases():
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

    def _phases(self) -> Iterator[tuple[float, float]]:
        """Seconds and acceleration of each phase from here to rest at the target; none crosses a standstill."""
        rate = self.acceleration_deg_s2
        braked_deg = self.angle_deg + self.speed_deg_s * abs(self.speed_deg_s) / (2 * rate)
        # All below is signed towards the target, seen from where braking now would end: that decides whether the motor
        # must turn round.
        sign = math.copysign(1.0, self.target_deg - braked_deg)
        ahead = sign * self.speed_deg_s
        way_deg = sign * (self.target_deg - self.angle_deg)
        # Speed at which accelerating meets braking: v² = v0²/2 + a·s, from s = (v² - v0²)/2a + v²/2a.
        peak = min(math.sqrt(max(rate * way_deg + ahead**2 / 2, 0.0)), self.top_speed_deg_s)
        if ahead < 0:
            yield -ahead / rate, sign * rate
            way_deg += ahead**2 / (2 * rate)
            ahead = 0.0
        yield abs(peak - ahead) / rate, math.copysign(rate, peak - ahead) * sign
        cruise_deg = way_deg - abs(peak**2 - ahead**2) / (2 * rate) - peak**2 / (2 * rate)
        if peak > 0:
            yield max(cruise_deg, 0.0) / peak, 0.0
        yield peak / rate, -sign * rate

    def _note(self) -> None:
        self.lowest_deg = min(self.lowest_deg, self.angle_deg)
        self.highest_deg = max(self.highest_deg, self.angle_deg)
