"""Motion of a stage with a trapezoidal speed: it speeds up, turns evenly, and brakes to rest at its target."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass


def phases(
    way_deg: float, *, speed_deg_s: float = 0.0, top_deg_s: float, acceleration_deg_s2: float
) -> Iterator[tuple[float, float]]:
    """Seconds and acceleration of each phase from here to rest at a target; none crosses a standstill.

    ``way_deg``: angle of the target from here, with its sign. ``speed_deg_s``: speed now, with its sign. A target that
    is nearer than the way of braking is overrun, and the motor turns round.
    """
    rate = acceleration_deg_s2
    # All below is signed towards the target, seen from where braking now would end: that decides whether the motor must
    # turn round.
    sign = math.copysign(1.0, way_deg - speed_deg_s * abs(speed_deg_s) / (2 * rate))
    ahead, left_deg = sign * speed_deg_s, sign * way_deg
    # Speed at which accelerating meets braking: v² = v0²/2 + a·s, from s = (v² - v0²)/2a + v²/2a.
    peak = min(math.sqrt(max(rate * left_deg + ahead**2 / 2, 0.0)), top_deg_s)
    if ahead < 0:
        yield -ahead / rate, sign * rate
        left_deg += ahead**2 / (2 * rate)
        ahead = 0.0
    yield abs(peak - ahead) / rate, math.copysign(rate, peak - ahead) * sign
    even_deg = left_deg - abs(peak**2 - ahead**2) / (2 * rate) - peak**2 / (2 * rate)
    if peak > 0:
        yield max(even_deg, 0.0) / peak, 0.0
    yield peak / rate, -sign * rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A way to one target, from a moment on; a new target begins a new leg from where the stage is."""

    began_s: float
    start_deg: float
    speed_deg_s: float
    """Speed at the beginning, with its sign."""
    target_deg: float
    top_deg_s: float
    acceleration_deg_s2: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Angle in degrees, and speed in degrees per second with its sign, at a time."""
        here_deg, speed, left_s = self.start_deg, self.speed_deg_s, max(time_s - self.began_s, 0.0)
        for phase_s, acceleration in phases(
            self.target_deg - self.start_deg,
            speed_deg_s=self.speed_deg_s,
            top_deg_s=self.top_deg_s,
            acceleration_deg_s2=self.acceleration_deg_s2,
        ):
            step_s = min(phase_s, left_s)
            here_deg += speed * step_s + acceleration * step_s**2 / 2
            speed += acceleration * step_s
            left_s -= step_s
            if left_s <= 0:
                return here_deg, speed
        return self.target_deg, 0.0
