"""A rotation stage like the Thorlabs PRM1Z8, simulated: speed, acceleration, encoder counts and lost motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import Clock, ConfigError, Interval, LimitError, require_range
from markerseek.sim.world import SimulatedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class StageMotion:
    """How a stage moves; the defaults are a PRM1Z8 on a KDC101.

    Attributes
    ----------
    speed_deg_s
        Largest speed in degrees per second; a PRM1Z8 reaches 25, direct drives some hundreds.
    acceleration_deg_s2
        Acceleration in degrees per second squared; a PRM1Z8 reaches 25.
    counts_per_deg
        Encoder counts for one degree.
    backlash_deg
        Play between the motor, which carries the encoder, and the probe, in degrees.
    approach_deg
        How far a move downwards goes beyond its target, to come back to it from below and leave the play on the same
        side always, in degrees; 0 does not.
    settle_s
        Rest after a move, in seconds.
    """

    speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    counts_per_deg: float = 1919.6418578623391
    backlash_deg: float = 0.1
    approach_deg: float = 1.0
    settle_s: float = 0.1

    def __post_init__(self) -> None:
        for name, most in (("speed_deg_s", 2000.0), ("acceleration_deg_s2", 50_000.0), ("counts_per_deg", 1e9)):
            if not 0 < getattr(self, name) <= most:
                raise ConfigError(f"stage motion: {name} is {getattr(self, name)}, it must lie in (0, {most}]")
        for name, most in (("backlash_deg", 360.0), ("approach_deg", 360.0), ("settle_s", 3600.0)):
            require_range(f"stage motion: {name}", getattr(self, name), low=0, high=most)

    def duration_s(self, distance_deg: float) -> float:
        """Seconds that a move takes from rest to rest, with a trapezoidal speed, without settling.

        Parameters
        ----------
        distance_deg
            Length of the move in degrees, of either sign.
        """
        distance = abs(distance_deg)
        # v²/a: the distance of speeding up and braking together. A shorter move never reaches the full speed.
        ramp = self.speed_deg_s**2 / self.acceleration_deg_s2
        if distance <= ramp:
            return 2 * math.sqrt(distance / self.acceleration_deg_s2)
        return distance / self.speed_deg_s + self.speed_deg_s / self.acceleration_deg_s2


class SimulatedStage:
    """Turns the world's probe, in virtual time.

    Parameters
    ----------
    world
        Whose probe is turned.
    clock
        Virtual time.
    motion
        How it moves.
    travel
        Angles that it accepts.
    """

    def __init__(self, *, world: SimulatedWorld, clock: Clock, motion: StageMotion, travel: Interval) -> None:
        self.limits = travel
        self._world = world
        self._clock = clock
        self._motion = motion
        # Whole counts: readback and setpoint differ by up to half a count, as on the device.
        self.counts = round(world.angle_deg * motion.counts_per_deg)

    @property
    def angle_deg(self) -> float:
        """Readback: the motor's encoder, in degrees; it does not know of the play."""
        return self.counts / self._motion.counts_per_deg

    def move_to(self, angle_deg: float) -> float:
        """Turn to an angle, from below, and return the readback in degrees.

        Raises
        ------
        LimitError
            If the angle is NaN or outside the travel range; nothing moves.
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
        try:
            self._clock.wait(duration_s)
        except BaseException:
            # Stopped on its way: where, is computed as if its speed were constant.
            share = (self._clock.now_s() - began_s) / duration_s if duration_s > 0 else 1.0
            self.counts = round((start_deg + share * way_deg) * self._motion.counts_per_deg)
            raise
        finally:
            # Pushed from below the probe is at the encoder's angle; pulled from above it lags by the play.
            play_deg = self._motion.backlash_deg
            self._world.angle_deg = min(max(self._world.angle_deg, self.angle_deg), self.angle_deg + play_deg)
