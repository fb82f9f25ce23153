"""Motion of a stage with a trapezoidal speed: it speeds up, turns evenly, and brakes to rest at its target."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A way to one target, from a moment on; a new target begins a new leg from where the stage is."""

    began_s: float
    start_deg: float
    speed_deg_s: float
    """Speed at the beginning towards the target, at least 0."""
    target_deg: float
    top_deg_s: float
    acceleration_deg_s2: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Angle in degrees, and speed towards the target in degrees per second, at a time."""
        way_deg = abs(self.target_deg - self.start_deg)
        gone_deg, speed = self._gone(max(time_s - self.began_s, 0.0), way_deg)
        return self.start_deg + math.copysign(gone_deg, self.target_deg - self.start_deg), speed

    def time_s(self, angle_deg: float) -> float:
        """When it comes by an angle of its way."""
        # Loaded here: scipy takes a while, and most rigs trigger nothing.
        from scipy.optimize import brentq

        even_s = abs(self.target_deg - self.start_deg) / self.top_deg_s
        ramp_s = self.top_deg_s / self.acceleration_deg_s2
        # Twice the longest that it can take.
        ends_s = self.began_s + 2 * (even_s + 2 * ramp_s)
        return float(brentq(lambda at_s: self.at(at_s)[0] - angle_deg, self.began_s, ends_s, xtol=1e-9))

    def _gone(self, elapsed_s: float, way_deg: float) -> tuple[float, float]:
        v0, a = self.speed_deg_s, self.acceleration_deg_s2
        # A target nearer than the way of braking is overrun: the stage comes to rest as soon as it can.
        way_deg = max(way_deg, v0**2 / (2 * a))
        # The speed at which speeding up and braking fill the whole way, v² = a·s + v0²/2, or the top speed.
        peak = max(min(self.top_deg_s, math.sqrt(a * way_deg + v0**2 / 2)), v0)
        up_s, down_s = (peak - v0) / a, peak / a
        up_deg, down_deg = (peak**2 - v0**2) / (2 * a), peak**2 / (2 * a)
        even_s = max(way_deg - up_deg - down_deg, 0.0) / peak if peak > 0 else 0.0
        if elapsed_s <= up_s:
            return v0 * elapsed_s + a * elapsed_s**2 / 2, v0 + a * elapsed_s
        if elapsed_s <= up_s + even_s:
            return up_deg + peak * (elapsed_s - up_s), peak
        left_s = up_s + even_s + down_s - elapsed_s
        if left_s <= 0:
            return way_deg, 0.0
        return way_deg - a * left_s**2 / 2, a * left_s
