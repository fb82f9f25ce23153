"""A rotation stage like the Thorlabs PRM1Z8, simulated: speed, acceleration, encoder counts and lost motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from markerseek.core import (
    Clock,
    Interval,
    LimitError,
    StageReading,
    Within,
    require_fields,
)
from markerseek.sim.trapezoid import Leg, phases
from markerseek.sim.world import SimulatedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class StageMotion:
    """How a stage moves; the defaults are a PRM1Z8 on a KDC101."""

    speed_deg_s: Annotated[float, Within(0, 2000, "deg/s", open_low=True)] = 10.0
    """Largest speed; a PRM1Z8 reaches 25, direct drives some hundreds."""
    acceleration_deg_s2: Annotated[float, Within(0, 50_000, "deg/s²", open_low=True)] = 10.0
    """Acceleration; a PRM1Z8 reaches 25."""
    counts_per_deg: Annotated[float, Within(0, 1e9, open_low=True)] = 1919.6418578623391
    """Encoder counts for one degree."""
    backlash_deg: Annotated[float, Within(0, 360, "deg")] = 0.1
    """Backlash between the motor, which carries the encoder, and the probe."""
    stated_backlash_deg: Annotated[float | None, Within(0, 360, "deg")] = None
    """Backlash that the rig states; None: the true one."""
    approach_deg: Annotated[float, Within(0, 360, "deg")] = 1.0
    """Way by which a move downwards goes beyond its target and comes back from below, so that the backlash is always on
    the same side; 0: no such way."""
    settle_s: Annotated[float, Within(0, 3600, "s")] = 0.1
    """Rest after a move."""

    def __post_init__(self) -> None:
        require_fields(self, "stage motion")

    def duration_s(self, distance_deg: float) -> float:
        """Seconds that a move takes from rest to rest, with a trapezoidal speed, without settling.

        ``distance_deg``: length of the move, of either sign.
        """
        way = phases(distance_deg, top_deg_s=self.speed_deg_s, acceleration_deg_s2=self.acceleration_deg_s2)
        return sum(seconds for seconds, _ in way)


_ANSWER_S, _READ_AFTER = 4e-3, 0.75
"""Time from a question to its answer in a sweep, in seconds, and the share of it after which the encoder is read: a
driver that takes the middle is 1 ms off."""


class SimulatedStage:
    """Turns the world's probe, in virtual time. In a sweep it has an angle at every moment."""

    def __init__(self, *, world: SimulatedWorld, clock: Clock, motion: StageMotion, travel: Interval) -> None:
        self.limits = travel
        self._world = world
        self._clock = clock
        self._motion = motion
        # Whole counts: readback and setpoint differ by up to half a count, as on the device.
        self.counts = round(world.angle_deg * motion.counts_per_deg)
        self._on_its_way: Callable[[], float] | None = None
        self._sweep_deg_s = motion.speed_deg_s
        self._sweep_from_deg = self._sweep_to_deg = 0.0
        self._legs: list[Leg] = []

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading, in degrees; while the stage turns, the present angle."""
        return self.angle_deg if self._on_its_way is None else self._on_its_way()

    @property
    def angle_deg(self) -> float:
        """Readback of the motor's encoder, in degrees, which does not include the backlash."""
        self._follow()
        return self.counts / self._motion.counts_per_deg

    def move_to(self, angle_deg: float) -> float:
        """Turn to an angle, from below, and return the readback in degrees.

        Raises `LimitError` if the angle is NaN or outside the travel range; nothing moves.
        """
        self._require_inside(angle_deg)
        self.end_sweep()
        # At the lower end of the travel there is no room below the target: the backlash then stays above.
        below_deg = max(angle_deg - self._motion.approach_deg, self.limits.low_deg)
        if angle_deg < self.angle_deg and below_deg < angle_deg:
            self._turn(below_deg)
        self._turn(angle_deg)
        self._clock.wait(self._motion.settle_s)
        return self.angle_deg

    def stop(self) -> None:
        """Brake, in a sweep; a move of this stage is over when `move_to` returns."""
        self.brake()

    @property
    def fastest_sweep_deg_s(self) -> float:
        """Largest speed of a sweep, in degrees per second."""
        return self._motion.speed_deg_s

    @property
    def acceleration_deg_s2(self) -> float:
        """Acceleration, in degrees per second squared."""
        return self._motion.acceleration_deg_s2

    def play_deg(self, forward: float) -> float:
        """Backlash between encoder and probe where the angle falls, in degrees."""
        motion = self._motion
        stated_deg = motion.backlash_deg if motion.stated_backlash_deg is None else motion.stated_backlash_deg
        return stated_deg if forward < 0 else 0.0

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        """Set the speed of a sweep."""
        self._sweep_deg_s = speed_deg_s

    def begin_sweep(self, to_deg: float) -> None:
        """Begin to turn to an angle; `LimitError` if it is outside the travel range."""
        self._require_inside(to_deg)
        self._come_to_rest()
        # It turns one way only, so the backlash is taken up from where the probe was at the beginning.
        self._sweep_to_deg, self._sweep_from_deg = to_deg, self._world.angle_deg
        self._legs = [self._leg(self.angle_deg, 0.0)]

    def read_sweep(self) -> StageReading:
        """Angle of the encoder, read some time after the question."""
        asked_s = self._clock.now_s()
        self._clock.wait(_READ_AFTER * _ANSWER_S)
        angle_deg = self.angle_deg
        self._clock.wait((1 - _READ_AFTER) * _ANSWER_S)
        return StageReading(angle_deg=angle_deg, asked_s=asked_s, answered_s=self._clock.now_s())

    def brake(self) -> None:
        """Begin to brake: the target is where it can come to rest."""
        if self._legs:
            here_deg, speed_deg_s = self._legs[-1].at(self._clock.now_s())
            self._sweep_to_deg = here_deg + speed_deg_s * abs(speed_deg_s) / (2 * self._motion.acceleration_deg_s2)
            self._legs.append(self._leg(here_deg, speed_deg_s))

    def end_sweep(self) -> None:
        """Come to rest; moves have their own speed here."""
        self._come_to_rest()

    def _come_to_rest(self) -> None:
        if self._legs:
            while self._legs[-1].at(self._clock.now_s())[1] != 0:
                self._clock.wait(0.01)
            self._follow()
            self._legs = []

    def probe_deg(self, at_s: float) -> float:
        """True angle of the probe at a time of the present sweep; outside of one, its angle now."""
        leg = next((each for each in reversed(self._legs) if each.began_s <= at_s), None)
        if leg is None:
            return self._world.angle_deg
        return self._pushed_deg(leg.at(at_s)[0], before_deg=self._sweep_from_deg)

    def _leg(self, here_deg: float, speed_deg_s: float) -> Leg:
        """The way to the end of the sweep, or to where it can come to rest."""
        return Leg(
            began_s=self._clock.now_s(),
            start_deg=here_deg,
            speed_deg_s=speed_deg_s,
            target_deg=self._sweep_to_deg,
            top_deg_s=self._sweep_deg_s,
            acceleration_deg_s2=self._motion.acceleration_deg_s2,
        )

    def _follow(self) -> None:
        """Set encoder and probe to where they are now, in a sweep."""
        if self._legs:
            motor_deg, _ = self._legs[-1].at(self._clock.now_s())
            self.counts = round(motor_deg * self._motion.counts_per_deg)
            self._world.angle_deg = self._pushed_deg(motor_deg, before_deg=self._sweep_from_deg)

    def _pushed_deg(self, motor_deg: float, *, before_deg: float) -> float:
        """True angle of the probe, which was at ``before_deg`` when the motor began.

        Pushed from below it is at the motor's angle, pulled from above it lags by the backlash.
        """
        return min(max(before_deg, motor_deg), motor_deg + self._motion.backlash_deg)

    def _require_inside(self, angle_deg: float) -> None:
        # An interval contains no NaN.
        if angle_deg not in self.limits:
            raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")

    def _turn(self, angle_deg: float) -> None:
        """Move the motor by whole counts; the probe follows once the backlash is taken up."""
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
            self._world.angle_deg = self._pushed_deg(self.angle_deg, before_deg=self._world.angle_deg)
