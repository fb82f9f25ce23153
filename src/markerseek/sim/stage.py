"""What turns the simulated probe: a stage like the Thorlabs PRM1Z8, with encoder counts and lost motion, and a hand.

A stage moves with a trapezoidal speed: it speeds up, turns evenly, and brakes to rest at its target. A hand overshoots,
comes to rest beside the angle asked for, and drifts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from markerseek.core import (
    Clock,
    Interval,
    LimitError,
    StageReading,
    Within,
    require_fields,
)
from markerseek.sim.world import SimulatedWorld


def phases(
    way_deg: float, *, speed_deg_s: float = 0.0, top_deg_s: float, acceleration_deg_s2: float
) -> Iterator[tuple[float, float]]:
    """Yield the seconds and acceleration of each phase from here to rest at a target; none crosses a standstill.

    ``way_deg``: angle of the target from here, with its sign. ``speed_deg_s``: speed now, with its sign. A target that
    is nearer than the way of braking is overrun, and the motor turns round.
    """
    rate = acceleration_deg_s2
    # All below is signed towards the target, seen from where braking now would end: that decides whether the motor must
    # turn round.
    sign = math.copysign(1.0, way_deg - speed_deg_s * abs(speed_deg_s) / (2 * rate))
    ahead = sign * speed_deg_s
    left_deg = sign * way_deg
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
        """Return the angle in degrees, and speed in degrees per second with its sign, at a time."""
        here_deg = self.start_deg
        speed = self.speed_deg_s
        left_s = max(time_s - self.began_s, 0.0)
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


class StageMotion(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
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
        """Return the seconds that a move takes from rest to rest, with a trapezoidal speed, without settling.

        ``distance_deg``: length of the move, of either sign.
        """
        way = phases(distance_deg, top_deg_s=self.speed_deg_s, acceleration_deg_s2=self.acceleration_deg_s2)
        return sum(seconds for seconds, _ in way)


_ANSWER_S = 4e-3
_READ_AFTER = 0.75
"""Time from a question to its answer in a sweep, in seconds, and the share of it after which the encoder is read: a
driver that takes the middle is 1 ms off."""


class SimulatedStage:
    """Turns the world's probe, in virtual time. In a sweep it has an angle at every moment."""

    def __init__(self, *, world: SimulatedWorld, clock: Clock, motion: StageMotion, travel: Interval) -> None:
        self.limits = travel
        self.fastest_sweep_deg_s = motion.speed_deg_s
        self.acceleration_deg_s2 = motion.acceleration_deg_s2
        self._world = world
        self._clock = clock
        self._motion = motion
        # Whole counts: readback and setpoint differ by up to half a count, as on the device.
        self.counts = round(world.angle_deg * motion.counts_per_deg)
        self._on_its_way: Callable[[], float] | None = None
        self._sweep_deg_s = motion.speed_deg_s
        self._sweep_from_deg = 0.0
        self._sweep_to_deg = 0.0
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

    def play_deg(self, forward: float) -> float:
        """Return the backlash between encoder and probe where the angle falls, in degrees."""
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
        self._sweep_to_deg = to_deg
        self._sweep_from_deg = self._world.angle_deg
        self._legs = [self._leg(self.angle_deg, 0.0)]

    def read_sweep(self) -> StageReading:
        """Return the angle of the encoder, read some time after the question."""
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
        """Return the true angle of the probe at a time of the present sweep; outside of one, its angle now."""
        leg = next((each for each in reversed(self._legs) if each.began_s <= at_s), None)
        if leg is None:
            return self._world.angle_deg
        return self._pushed_deg(leg.at(at_s)[0], before_deg=self._sweep_from_deg)

    def _leg(self, here_deg: float, speed_deg_s: float) -> Leg:
        """Return the way to the end of the sweep, or to where it can come to rest."""
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
        """Return the true angle of the probe, which was at ``before_deg`` when the motor began.

        Pushed from below it is at the motor's angle, pulled from above it lags by the backlash.
        """
        return min(max(before_deg, motor_deg), motor_deg + self._motion.backlash_deg)

    def _require_inside(self, angle_deg: float) -> None:
        # An interval contains no NaN.
        if angle_deg not in self.limits:
            raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")

    def _turn(self, angle_deg: float) -> None:
        """Move the motor by whole counts; the probe follows once the backlash is taken up."""
        start_deg = self.angle_deg
        began_s = self._clock.now_s()
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
        self._world = world
        self._clock = clock
        self._limits = limits
        self._rng = rng
        self._motion = motion or HandMotion()
        # Moments in seconds, and the angle in degrees at each.
        self._times_s = np.array([clock.now_s()])
        self._angles_deg = np.array([world.angle_deg])
        self._drift_deg_s = 0.0

    def turn_to(self, angle_deg: float) -> None:
        """Begin to turn the probe to an angle in degrees."""
        motion = self._motion
        here_deg = self._now_deg()
        now_s = self._clock.now_s()
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
        """Return the angle of the probe now, in steps of the encoder, in degrees."""
        self._world.angle_deg = self._now_deg()
        return round(self._world.angle_deg / self._motion.resolution_deg) * self._motion.resolution_deg

    def _now_deg(self) -> float:
        now_s = self._clock.now_s()
        drifted_deg = self._drift_deg_s * max(0.0, now_s - float(self._times_s[-1]))
        return float(np.interp(now_s, self._times_s, self._angles_deg)) + drifted_deg
