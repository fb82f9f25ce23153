"""A rotation stage like the Thorlabs PRM1Z8, simulated: speed, acceleration, encoder counts and lost motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from markerseek.core import Clock, ConfigError, Interval, LimitError, require_range
from markerseek.sim.world import SimulatedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class StageMotion:
    """How a stage moves; the defaults are a PRM1Z8 on a KDC101."""

    speed_deg_s: float = 10.0
    """Largest speed; a PRM1Z8 reaches 25, direct drives some hundreds."""
    acceleration_deg_s2: float = 10.0
    """Acceleration; a PRM1Z8 reaches 25."""
    counts_per_deg: float = 1919.6418578623391
    """Encoder counts for one degree."""
    backlash_deg: float = 0.1
    """Play between the motor, which carries the encoder, and the probe."""
    approach_deg: float = 1.0
    """How far a move downwards goes beyond its target, to come back to it from below and leave the play on the same
    side always; 0 does not."""
    settle_s: float = 0.1
    """Rest after a move."""

    def __post_init__(self) -> None:
        for name, most in (("speed_deg_s", 2000.0), ("acceleration_deg_s2", 50_000.0), ("counts_per_deg", 1e9)):
            if not 0 < getattr(self, name) <= most:
                raise ConfigError(f"stage motion: {name} is {getattr(self, name)}, it must lie in (0, {most}]")
        for name, most in (("backlash_deg", 360.0), ("approach_deg", 360.0), ("settle_s", 3600.0)):
            require_range(f"stage motion: {name}", getattr(self, name), low=0, high=most)

    def duration_s(self, distance_deg: float) -> float:
        """Seconds that a move takes from rest to rest, with a trapezoidal speed, without settling.

        ``distance_deg``: length of the move, of either sign.
        """
        distance = abs(distance_deg)
        # v²/a: the distance of speeding up and braking together. A shorter move never reaches the full speed.
        ramp = self.speed_deg_s**2 / self.acceleration_deg_s2
        if distance <= ramp:
            return 2 * math.sqrt(distance / self.acceleration_deg_s2)
        return distance / self.speed_deg_s + self.speed_deg_s / self.acceleration_deg_s2


class SimulatedStage:
    """Turns the world's probe, in virtual time."""

    def __init__(self, *, world: SimulatedWorld, clock: Clock, motion: StageMotion, travel: Interval) -> None:
        self.limits = travel
        self._world = world
        self._clock = clock
        self._motion = motion
        # Whole counts: readback and setpoint differ by up to half a count, as on the device.
        self.counts = round(world.angle_deg * motion.counts_per_deg)
        self._on_its_way: Callable[[], float] | None = None

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading, in degrees; while it turns, that of now."""
        return self.angle_deg if self._on_its_way is None else self._on_its_way()

    @property
    def angle_deg(self) -> float:
        """Readback: the motor's encoder, in degrees; it does not know of the play."""
        return self.counts / self._motion.counts_per_deg

    def move_to(self, angle_deg: float) -> float:
        """Turn to an angle, from below, and return the readback in degrees.

        Raises `LimitError` if the angle is NaN or outside the travel range; nothing moves.
        """
        # An interval contains no NaN.
        if angle_deg not in self.limits:
            raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")
        # At the lower end of the travel there is no room below the target: the play then stays above.
        below_deg = max(angle_deg - self._motion.approach_deg, self.limits.low_deg)
        if angle_deg < self.angle_deg and below_deg < angle_deg:
            self._turn(below_deg)
        self._turn(angle_deg)
        self._clock.wait(self._motion.settle_s)
        return self.angle_deg

    def stop(self) -> None:
        """Nothing to do: a move of this stage is over when `move_to` returns."""

    def _turn(self, angle_deg: float) -> None:
        """Move the motor by whole counts; the probe follows once the play is taken up."""
        start_deg, began_s = self.angle_deg, self._clock.now_s()
        self.counts = round(angle_deg * self._motion.counts_per_deg)
        way_deg = self.angle_deg - start_deg
        duration_s = self._motion.duration_s(way_deg)

        def here_deg() -> float:
            # As if its speed were constant.
            share = (self._clock.now_s() - began_s) / duration_s if duration_s > 0 else 1.0
            return start_deg + share * way_deg

        self._on_its_way = here_deg
        try:
            self._clock.wait(duration_s)
        except BaseException:
            # Stopped on its way.
            self.counts = round(here_deg() * self._motion.counts_per_deg)
            raise
        finally:
            self._on_its_way = None
            # Pushed from below the probe is at the encoder's angle; pulled from above it lags by the play.
            play_deg = self._motion.backlash_deg
            self._world.angle_deg = min(max(self._world.angle_deg, self.angle_deg), self.angle_deg + play_deg)
