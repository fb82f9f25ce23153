"""A stage from its verbs: limits, approach, read-back, deadlines and stop of every stage with a motor stand here.

A target is always approached from the same side, where the travel range allows it. The target of a move is never more
than a few degrees ahead: a computer that dies leaves the stage there, and not at the end of a long move. The target of
a sweep is the end of its permit, where the stage stops by itself.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Generic, Literal, Protocol, TypeVar

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
    Interval,
    LimitError,
    MoveError,
    StageReading,
)
from markerseek.drivers._stage_move import Move
from markerseek.drivers._stage_rules import StageLogic, StageRules
from markerseek.drivers.clock import polls
from markerseek.guard import Limits

UP = 1
DOWN = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Angles to go to in turn: to the last always from the same side, so that the backlash does not matter."""

    stops_deg: tuple[float, ...]
    """Angles to go to; none if the stage is there already, approached from the right side."""
    direction: int
    """`UP` if the last is approached from below, `DOWN` if from above."""
    reversed: bool
    """Whether that is not the usual side, because the travel range ends too soon."""


def plan_approach(
    target_deg: float,
    *,
    here_deg: float,
    pushed: int | None,
    usual: int,
    room_deg: float,
    travel: Interval,
    same_deg: float,
) -> Approach:
    """Plan the approach of a target.

    ``target_deg``, ``here_deg``: target, and present angle of the stage. ``pushed``: direction of the last move, `UP`
    or `DOWN`; None if unknown. ``usual``: direction of the last move towards any target. ``room_deg``: length of a move
    that takes up the backlash. ``travel``: angles at which the stage may be. ``same_deg``: angles no further apart than
    this count as equal.
    """
    direction = usual if target_deg - usual * room_deg in travel else -usual
    # From a shorter distance, or from the other side, the gears would not yet be pushed when the target is reached.
    way_deg = direction * (target_deg - here_deg)
    if pushed == direction and abs(way_deg) <= same_deg:
        stops: tuple[float, ...] = ()
    elif way_deg >= (0 if pushed == direction else room_deg):
        stops = (target_deg,)
    else:
        stops = (target_deg - direction * room_deg, target_deg)
    return Approach(stops_deg=stops, direction=direction, reversed=direction != usual)


def require_inside(travel: Interval, angle_deg: float, *, then: str = "nothing was moved") -> None:
    """Refuse a target outside the travel range, and NaN, which is in no interval; ``then``: what was not done."""
    if angle_deg not in travel:
        raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {travel}; {then}")


def require_wide(travel: Interval, *, approach_deg: float) -> None:
    """Refuse a travel range in which no target could be approached from one side, or of a turn and more."""
    if not 2 * approach_deg <= travel.width_deg <= 359:
        raise ConfigError(
            f"stage: the travel range {travel} must be at least twice approach_deg ({approach_deg} deg) "
            "wide, and less than a turn"
        )


def require_approach(limits: Limits, *, approach_from: Literal["below", "above"], approach_deg: float) -> None:
    """Refuse a search range whose ends cannot be approached from the usual side."""
    # Approached from the other side, an angle would be off by the backlash of the gears, and the marker with it.
    from_below = approach_from == "below"
    farthest_deg = limits.search.low_deg if from_below else limits.search.high_deg
    start_deg = farthest_deg - approach_deg if from_below else farthest_deg + approach_deg
    if start_deg not in limits.travel:
        raise ConfigError(
            f"stage: to arrive at {farthest_deg:g} deg from {approach_from} the stage must start at "
            f"{start_deg:g} deg, outside the travel range {limits.travel}; narrow limits.search, widen "
            "limits.travel, or shorten stage.approach_deg"
        )


_STOP_S = 1.0
_STOP_AGAIN_S = 0.02
_READS = 6


class SweepLogic(StageLogic, Protocol):
    """The verbs of a stage that can sweep."""

    def set_speed(self, speed_deg_s: float | None) -> float:
        """Set the speed of what follows, None for that of moves, and return it as the stage keeps it."""

    def brake(self) -> None:
        """Begin to brake with the acceleration that was set; called again until the sweep is over."""


LogicT = TypeVar("LogicT", bound=StageLogic)


class StandardStage(Generic[LogicT]):
    """A `markerseek.core.Stage` that turns by the verbs of its logic.

    - ``logic``: the stage's verbs; it is connected, and nothing moves.
    - ``clock``: all waiting is done on it, so that each wait renews a lease.
    - ``travel``: angles at which the probe may be.
    - ``rules``: how it moves, and what is believed of it.
    - ``approach_reversed``: whether the last target was approached from the other side, because the travel range ends
      too soon: its angle is off by the backlash of the gears.
    """

    def __init__(self, logic: LogicT, *, clock: Clock, travel: Interval, rules: StageRules) -> None:
        require_wide(travel, approach_deg=rules.approach_deg)
        self.logic = logic
        self.limits = travel
        self.rules = rules
        self._clock = clock
        self.approach_reversed = False
        self._usual = UP if rules.approach_from == "below" else DOWN
        self._pushed: int | None = None
        self._move: Move | None = None
        self._rest_deg: float | None = None

    @property
    def emulated(self) -> bool:
        """Whether the device says that it is an emulator."""
        return bool(getattr(self.logic, "emulated", False))

    @property
    def driver(self) -> str:
        """Name of the driver, in an error."""
        return str(getattr(self.logic, "driver", type(self).__name__))

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading while it turns, in degrees, without another one; NaN at rest."""
        seen_deg = None if self._move is None else self._move.seen_deg
        return math.nan if seen_deg is None else seen_deg

    @property
    def angle_deg(self) -> float:
        """Readback of the angle, now, in degrees: two readings in a row that agree.

        Raises `MoveError` if it reports an error, or has turned by itself since it came to rest. Raises `LimitError` if
        it is outside its travel range; it was sent a stop.
        """
        try:
            return self._readback()
        except DeviceError:
            self._stop_after_error()
            raise

    def move_to(self, angle_deg: float) -> float:
        """Move to an angle, approach it from the usual side, come to rest, and return the readback in degrees.

        Raises `LimitError` if the angle is NaN or outside the travel range, and nothing moves; or if the stage left
        that range. Raises `MoveError` if it does not arrive. Raises `DeviceTimeoutError` if it stops answering.
        """
        require_inside(self.limits, angle_deg)
        here_deg = self._readback()
        approach = plan_approach(
            angle_deg,
            here_deg=here_deg,
            pushed=self._pushed,
            usual=self._usual,
            room_deg=self.rules.approach_deg,
            travel=self.limits,
            same_deg=self.rules.resolution_deg,
        )
        arrived = False
        self._rest_deg = None
        self._pushed = None
        try:
            for stop_deg in approach.stops_deg:
                self._move = self._way()
                here_deg = self._move.go(stop_deg, here_deg)
            arrived = True
        finally:
            # In `finally`, so that Ctrl-C stops the stage too.
            self._move = None
            if not arrived:
                self._stop_after_error()
        # From here on the stage must read this position: any other means that something turned it.
        self._rest_deg = here_deg
        self._pushed = approach.direction
        self.approach_reversed = approach.reversed
        return here_deg

    def stop(self) -> None:
        """Stop at once, and check that it is at rest; allowed at any time, also twice.

        Raises `MoveError` if it keeps moving. Raises `DeviceTimeoutError` if it does not report whether it moves.
        """
        self._note_rest(self._come_to_rest())

    def _note_rest(self, angle_deg: float) -> None:
        if self._rest_deg is None or not abs(angle_deg - self._rest_deg) <= self.rules.same_deg:
            self._rest_deg = None
            self._pushed = None

    def _come_to_rest(self) -> float:
        """Stop, until two answers in a row say that it is at rest; returns where, in degrees."""
        before_deg: float | None = None
        for _ in polls(self._clock, within_s=_STOP_S + self.rules.brake_s, every_s=_STOP_AGAIN_S):
            # Sent again each time: without a checksum, a damaged stop is ignored and nobody reports it.
            self.logic.stop()
            status = self.logic.read()
            here_deg = status.angle_deg
            if not status.moving and before_deg is not None and abs(here_deg - before_deg) <= self.rules.same_deg:
                return here_deg
            before_deg = None if status.moving else here_deg
        raise MoveError("the stage got a stop command and keeps moving; cut its power")

    def _stop_after_error(self) -> None:
        """Stop after an error; a second error here must not hide the first."""
        self._rest_deg = None
        self._pushed = None
        with suppress(DeviceError):
            self.stop()

    def _way(self, *, rest_deg: float | None = None, rules: StageRules | None = None) -> Move:
        return Move(
            logic=self.logic, clock=self._clock, rules=rules or self.rules, travel=self.limits, rest_deg=rest_deg
        )

    def _readback(self) -> float:
        """Return the angle, read twice in a row: a garbled answer does not come twice."""
        last_deg: float | None = None
        for _ in range(_READS):
            angle_deg = self._way(rest_deg=self._rest_deg).look().angle_deg
            if last_deg is not None and abs(angle_deg - last_deg) <= self.rules.same_deg:
                return angle_deg
            last_deg = angle_deg
        raise MoveError("the stage turns without a command; keep hands off its wheel, and end other programs")


SweepLogicT = TypeVar("SweepLogicT", bound=SweepLogic)


class StandardSweepingStage(StandardStage[SweepLogicT]):
    """A `markerseek.core.SweepingStage`; as `StandardStage`.

    ``play``: backlash of the gears in degrees, by which the probe lags in a sweep away from the side of approach.
    """

    def __init__(
        self, logic: SweepLogicT, *, clock: Clock, travel: Interval, rules: StageRules, play: float = 0.0
    ) -> None:
        super().__init__(logic, clock=clock, travel=travel, rules=rules)
        self._play_deg = play
        self._sweep: SweepMove | None = None
        self._sweep_rules = rules
        self._has_speed_of_sweep = False

    @property
    def acceleration_deg_s2(self) -> float:
        """Acceleration as the stage keeps it, in degrees per second squared."""
        return self.rules.acceleration_deg_s2 or 0.0

    @property
    def fastest_sweep_deg_s(self) -> float:
        """Largest speed of a sweep, in degrees per second."""
        return self.rules.speed_deg_s

    def play_deg(self, forward: float) -> float:
        """Return the largest backlash in a sweep in that direction: 0 in that of the approach of a target."""
        return 0.0 if forward == self._usual else self._play_deg

    def move_to(self, angle_deg: float) -> float:
        """As of `StandardStage`, with the speed of moves."""
        require_inside(self.limits, angle_deg)
        self.end_sweep()
        return super().move_to(angle_deg)

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        """Set the speed of a sweep, and read it back.

        Raises `MoveError` if the controller does not keep it. Raises `DeviceTimeoutError` if it does not answer in
        time.
        """
        # Noted first: half of a write may have reached it.
        self._has_speed_of_sweep = True
        self._sweep_rules = replace(self.rules, speed_deg_s=self.logic.set_speed(speed_deg_s))

    def begin_sweep(self, to_deg: float) -> None:
        """Begin to turn there; refused by `LimitError` as `move_to`."""
        require_inside(self.limits, to_deg)
        # Not read again where it is known: the first reading of the sweep must come soon, and is compared with it.
        start_deg = self._readback() if self._rest_deg is None else self._rest_deg
        self._rest_deg = None
        self._pushed = None
        self._move = self._way(rules=self._sweep_rules)
        self._sweep = SweepMove(self.logic, self._move, self._sweep_rules, to_deg=to_deg, start_deg=start_deg)

    def read_sweep(self) -> StageReading:
        """Return where it is, with the times of question and answer.

        Raises `MoveError` if it is where a sound stage cannot be, or reports an error. Raises `LimitError` if it left
        its travel range. Raises `DeviceTimeoutError` if it does not answer in time.
        """
        if self._sweep is None:
            raise MoveError("the stage does not sweep: it was stopped; begin the sweep again")
        return self._sweep.read()

    def brake(self) -> None:
        """Begin to brake, with its acceleration."""
        if self._sweep is not None:
            self._sweep.brake()

    def end_sweep(self) -> None:
        """Restore the speed of moves; raises as `prepare_sweep`."""
        sweep = self._sweep
        self._sweep = None
        self._move = None
        if sweep is not None:
            self._rest_deg = sweep.here_deg
            pushed = abs(sweep.here_deg - sweep.start_deg) >= self.rules.approach_deg
            self._pushed = sweep.heading if pushed else None
        if self._has_speed_of_sweep:
            self.logic.set_speed(None)
            self._has_speed_of_sweep = False

    def stop(self) -> None:
        """As of `StandardStage`; after a sweep it has the speed of moves again."""
        angle_deg = self._come_to_rest()
        self.end_sweep()
        self._note_rest(angle_deg)


class SweepMove:
    """A stage that sweeps from rest to rest, to the end of its permit.

    Making one begins to turn it. ``rules``: with the speed of the sweep.
    """

    def __init__(self, logic: SweepLogic, move: Move, rules: StageRules, *, to_deg: float, start_deg: float) -> None:
        self._logic = logic
        self._move = move
        self._rules = rules
        self.start_deg = start_deg
        self.here_deg = start_deg
        self.heading = 1 if to_deg > start_deg else -1
        self._to_deg = to_deg
        self._braking = False
        move.begin(to_deg, start_deg, evenly=True)
        move.aim(to_deg)

    def read(self) -> StageReading:
        """Return where it is, checked as in a move."""
        status, reading = self._move.look_dated()
        if self._braking:
            # Sent again: without a checksum, a damaged stop is ignored and nobody reports it.
            self._logic.brake()
        elif not status.moving and self.heading * (self._to_deg - reading.angle_deg) > self._rules.arrival_deg:
            # A line may have lost the target.
            self._move.aim(self._to_deg)
        self.here_deg = reading.angle_deg
        return reading

    def brake(self) -> None:
        """Begin to brake, with the deceleration that was set."""
        self._braking = True
        self._move.brake()
        self._logic.brake()
