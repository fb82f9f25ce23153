"""One move of a stage: a target that is renewed, and the checks of all that the stage says on its way.

A stage on its way does not turn back, and changes its speed no faster than it was set to (`Course`). An encoder that
jumps in mid-move shows itself there: backwards as a fall-back, or either way as a speed that no motor with the
acceleration that was set can have.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

from markerseek.core import (
    MAX_AHEAD_DEG,
    MAX_RESOLUTION_DEG,
    Clock,
    DeviceError,
    Interval,
    LimitError,
    MoveError,
    StageReading,
    Within,
    require_fields,
)
from markerseek.drivers._even import Even

_SCALES = (
    (1.0, ""),
    (math.pi / 180, "one of read() and go() is in radians"),
    (180 / math.pi, "go() is in radians"),
    (1000 * math.pi / 180, "read() is in mrad"),
    (1000.0, "one of read() and go() is in thousandths of a degree"),
    (1e-3, "one of read() and go() is in thousands of degrees"),
    (60.0, "read() is in arcminutes"),
    (3600.0, "read() is in arcseconds"),
    (1 / 360, "read() is in turns"),
)
"""Ratios of a reading to what was asked, and the unit that explains each."""

_SAME_SCALE = 0.02
"""Share by which a ratio may differ from that of a unit."""

_OFF_SCALE = 5.0
"""Ratio of a way to the longest possible one from which on its unit is doubted."""

_RENEW_S = 0.1
"""How often a target is renewed, in seconds."""
_POLL_S = 0.05
_NEAR_POLL_S = 0.02
_STABLE_READS = 3
_SETTLES_S = 0.5
"""Time in which a servo settles at the end of a move, in seconds."""
_TICK_S = 1e-6
_MAX_TIMES = 5
"""Multiple of its usual longest time that a move may take on a computer that is held up."""
_TOO_FAST = 1.25
"""Share of speed and acceleration set that is put down to the servo and to the age of two readings."""
_APART_S = 0.015
"""Readings closer together than this give no speed."""
_KEPT = 6
"""Readings that are compared with: a short way back the speed is recent, a long way back it is well known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageStatus:
    """What a stage says of itself."""

    angle_deg: float
    """Angle of the probe by the stage's own encoder or count, in degrees."""
    moving: bool = False
    """Whether the stage says that it moves; some deny it for a moment after a command."""
    problem: str = ""
    """Why the stage must not be used, with its cure; empty if all is well. It is asked a second time before this is
    believed."""
    since_s: float | None = None
    """Earliest time at which the angle can have been taken, in seconds of the clock; None: when it was asked for."""
    cure: str = "look for an obstacle"
    """What to do where the stage does not move."""


class StageLogic(Protocol):
    """The verbs of a stage, in degrees of the probe. Each returns at once; waiting and checking is `StandardStage`'s.

    A class may have the attributes ``emulated``, whether it is no real device, and ``description``.
    """

    def read(self) -> StageStatus:
        """Return what the stage says now."""

    def go(self, angle_deg: float) -> float | None:
        """Begin to turn to an angle; it is called on the way again, with the next target.

        Returns when the command was sent, in seconds of the clock; None: when this was called.
        """

    def stop(self) -> None:
        """Begin to stop; it is called again until the stage is at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRules:
    """How a stage is moved and checked; angles in degrees of the probe."""

    speed_deg_s: Annotated[float, Within(0, 1e4, "deg/s", open_low=True)]
    """Speed of its moves, as the stage keeps it."""
    acceleration_deg_s2: float | None = None
    """Its acceleration, as the stage keeps it; None: not known, and only the speed is checked."""
    resolution_deg: Annotated[float, Within(0, MAX_RESOLUTION_DEG, "deg", open_low=True)]
    """Step of its readback; two readings at rest differ by two steps at most."""
    arrival_deg: Annotated[float, Within(0, 0.2, "deg", open_low=True)] = 0.01
    """Largest distance from its target at which it counts as arrived."""
    unexpected_deg: float = 0.2
    """Largest distance from where it should be on its way, and at rest."""
    unsteady_deg: float = 0.0105
    """How far a servo may be ahead of its set point, at any speed."""
    settle_deg: float = 0.0
    """How far a servo may be off the angle at which it comes to rest, until it has settled."""
    begin_s: Annotated[float, Within(0, 60, "s", open_low=True)] = 0.5
    """Time without motion after which it counts as stuck, in seconds."""
    brake_s: float = 0.0
    """Time that it takes to come to rest after a stop, in seconds."""
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 0.0
    """``approach_from`` and ``approach_deg``: side from which every target is approached, and over what distance."""

    def __post_init__(self) -> None:
        require_fields(self, "stage")

    @property
    def same_deg(self) -> float:
        """Most by which two readings at rest differ."""
        return 2.01 * self.resolution_deg

    @property
    def ramp_s(self) -> float:
        """Time to its full speed."""
        return 0.0 if self.acceleration_deg_s2 is None else self.speed_deg_s / self.acceleration_deg_s2

    def longest_s(self, way_deg: float) -> float:
        """Return the longest time that a move of that length may take, in seconds."""
        # A fast stage waits for its next target.
        speed_deg_s = min(self.speed_deg_s, MAX_AHEAD_DEG / (2 * _RENEW_S))
        return 2 * (way_deg / speed_deg_s + self.ramp_s) + 2 * self.begin_s

    def reach_deg(self, duration_s: float) -> float:
        """Return the farthest that a motor gets from rest in that time, with what it may exceed its settings by."""
        ramp_s = min(duration_s, self.ramp_s)
        ramp_deg = 0.0 if self.acceleration_deg_s2 is None else self.acceleration_deg_s2 * ramp_s**2 / 2
        return _TOO_FAST * (ramp_deg + self.speed_deg_s * (duration_s - ramp_s))


def unit_doubt(asked_deg: float, reading_deg: float) -> str:
    """Return the end of an error: the unit or sign that explains why a stage reads another angle than was asked."""
    ratio = reading_deg / asked_deg if asked_deg else 0.0
    for scale, unit in _SCALES:
        if ratio and abs(abs(ratio) / scale - 1) <= _SAME_SCALE and not (ratio > 0 and scale == 1):
            times = f"{scale:.4g}" if scale >= 1 else f"1/{1 / scale:.4g}"
            whys = [unit, "the signs of read() and go() differ" if ratio < 0 else ""]
            why = " and ".join(filter(None, whys))
            return f"; the reading is {'-' if ratio < 0 else ''}{times} x what was asked: {why}"
    return ""


class Course:
    """The readings of one move from rest, in one direction.

    Each reading was taken at some time between the question and its answer; every bound takes the ends of these times
    that speak for the stage. What holds up the computer, the line or the answers widens these times and with them the
    bounds: it hides small jumps, and makes no jump of a sound stage.

    ``start_deg``: where it stands. ``heading``: 1 for upwards, -1 for downwards. ``acceleration_deg_s2``: largest
    acceleration, with what a motor may exceed its setting by. ``unsteady_deg``: how far a servo may be off the way that
    it was set: noise of the encoder. ``settle_deg``: the same where it comes to rest: it swings there until it settles.

    ``speed_deg_s``: speed at which it turns evenly between its ramps; None: it is given one target after the other.
    ``brakes``: whether it comes to rest anywhere from now on.
    """

    def __init__(
        self,
        *,
        start_deg: float,
        target_deg: float,
        now_s: float,
        acceleration_deg_s2: float,
        unsteady_deg: float,
        settle_deg: float,
        speed_deg_s: float | None = None,
    ) -> None:
        self._heading = 1 if target_deg > start_deg else -1
        # Ends of the way, and targets at which it may stand in between, if the next one is late.
        self._ends_deg = (start_deg, target_deg)
        self._aims_deg: deque[float] = deque(maxlen=_KEPT)
        self._acceleration = acceleration_deg_s2
        self._least_unsteady_deg = unsteady_deg
        self._settle_deg = settle_deg
        self.brakes = False
        self._speed_deg_s = speed_deg_s
        self._even = Even() if speed_deg_s is None else Even(slowest=1 / (_TOO_FAST * speed_deg_s))
        self._farthest_deg = start_deg
        first = StageReading(angle_deg=start_deg, asked_s=now_s, answered_s=now_s)
        self._last: deque[StageReading] = deque([first], maxlen=_KEPT)

    def objection(self, reading: StageReading) -> str:
        """Return why a stage on this course cannot be there; empty if it can."""
        back_deg = self._heading * (self._farthest_deg - reading.angle_deg)
        unsteady_deg = self._unsteady_deg(reading.angle_deg)
        cure = "switch it off and on, home it with the probe outside the patient"
        if back_deg > unsteady_deg:
            return (
                f"the stage fell back by {back_deg:.3f} deg on its way, to {reading.angle_deg:.3f} deg; its encoder or "
                f"its coupling slips: {cure}"
            )
        if len(self._last) < 2:
            return ""
        *earlier, last = self._last
        bounds = [self._advances(first, last, reading, unsteady_deg=unsteady_deg) for first in earlier]
        low_deg = max(low for low, _ in bounds)
        high_deg = min(high for _, high in bounds)
        advance_deg = self._heading * (reading.angle_deg - last.angle_deg)
        if low_deg <= advance_deg <= high_deg:
            return self._uneven(reading, cure)
        return (
            f"the stage advanced by {advance_deg:.3f} deg where its acceleration allows {low_deg:.3f} to "
            f"{high_deg:.3f} deg; its encoder jumped, or its motor slips: {cure}"
        )

    def _uneven(self, reading: StageReading, cure: str) -> str:
        """Return why a stage that turned evenly so far cannot be there; empty if it can."""
        moments_s = self._even_moments_s(reading)
        if moments_s is None or self._speed_deg_s is None:
            return ""
        earliest_s, latest_s = moments_s
        jump_s = self._even.jump_s(self._heading * reading.angle_deg, earliest_s=earliest_s, latest_s=latest_s)
        if not jump_s > 0:
            return ""
        return (
            f"the stage turned evenly, and is {jump_s * self._speed_deg_s:.3f} deg or more off its way at "
            f"{reading.angle_deg:.3f} deg; its encoder jumped, or its coupling slips: {cure}"
        )

    def _even_moments_s(self, reading: StageReading) -> tuple[float, float] | None:
        """Return the earliest and latest moment of a reading between the ramps; None of another one."""
        if self._speed_deg_s is None or self.brakes:
            return None
        ramp_deg = _TOO_FAST**2 * self._speed_deg_s**2 / (2 * self._acceleration) + self._settle_deg
        if min(abs(reading.angle_deg - end_deg) for end_deg in self._ends_deg) < ramp_deg:
            return None
        spare_s = self._least_unsteady_deg / self._speed_deg_s
        return reading.asked_s - spare_s, reading.answered_s + spare_s

    @property
    def sweeps(self) -> bool:
        """Whether it turns evenly between its ramps."""
        return self._speed_deg_s is not None

    def swing_deg(self, *angles_deg: float) -> float:
        """Return how far apart two readings of a servo that settles may be, if it settles at these angles; 0 if not."""
        # It swings to both sides of its rest.
        rests_deg = (*self._ends_deg, *self._aims_deg)
        rests = self.brakes or any(
            max(abs(angle_deg - rest_deg) for angle_deg in angles_deg) <= self._settle_deg for rest_deg in rests_deg
        )
        return 2 * self._settle_deg if rests else 0.0

    def _unsteady_deg(self, angle_deg: float) -> float:
        """Return how far a servo may be off its way at an angle."""
        return max(self._least_unsteady_deg, self.swing_deg(angle_deg))

    def _advances(
        self, first: StageReading, second: StageReading, third: StageReading, *, unsteady_deg: float
    ) -> tuple[float, float]:
        """Return the least and largest advance from the second reading to the third, by the speed before."""
        advance_deg = self._heading * (second.angle_deg - first.angle_deg)
        change = self._acceleration * (third.answered_s - first.asked_s)
        slowest = (advance_deg - unsteady_deg) / (second.answered_s - first.asked_s) - change
        fastest = (advance_deg + unsteady_deg) / max(second.asked_s - first.answered_s, 1e-3) + change
        low_deg = max(slowest, 0.0) * max(third.asked_s - second.answered_s, 0.0) - unsteady_deg
        return low_deg, max(fastest, 0.0) * (third.answered_s - second.asked_s) + unsteady_deg

    def aim(self, angle_deg: float) -> None:
        """Note a target at which it may come to rest."""
        self._aims_deg.append(angle_deg)

    def add(self, reading: StageReading) -> None:
        """Add a reading that has passed all checks."""
        if self._heading * (reading.angle_deg - self._farthest_deg) > 0:
            self._farthest_deg = reading.angle_deg
        if (moments_s := self._even_moments_s(reading)) is not None:
            earliest_s, latest_s = moments_s
            self._even.add(self._heading * reading.angle_deg, earliest_s=earliest_s, latest_s=latest_s)
        if reading.asked_s - self._last[-1].answered_s >= _APART_S:
            self._last.append(reading)


class Move:
    """A stage on its way, or at rest between two moves.

    ``rest_deg``: where it stands, if it should not move; None if that is not known. ``seen_deg``: angle of the last
    reading; None before the first.
    """

    def __init__(
        self, *, logic: StageLogic, clock: Clock, rules: StageRules, travel: Interval, rest_deg: float | None = None
    ) -> None:
        self._logic = logic
        self._clock = clock
        self._rules = rules
        self._travel = travel
        self._corridor = (travel.low_deg, travel.high_deg) if rest_deg is None else (rest_deg, rest_deg)
        self._asked_s = 0.0
        self.seen_deg: float | None = None
        self._course: Course | None = None
        self._from_deg: float | None = None
        self._begun_s: float | None = None
        self._aim_deg: float | None = None

    def look(self) -> StageStatus:
        """Return a status that a stage on its way can have.

        One that it cannot have is asked for again, because a garbled answer does not come twice.

        Raises `MoveError` if it reports an error, was switched off, homes, fell back on its way, or is where it cannot
        be. Raises `LimitError` if it is outside its travel range.
        """
        return self.look_dated()[0]

    def look_dated(self) -> tuple[StageStatus, StageReading]:
        """As `look`, with the times between which it was taken."""
        status, reading = self._ask()
        if self._objection(status, reading) is not None:
            status, reading = self._ask()
            objection = self._objection(status, reading)
            if objection is not None:
                raise objection
        self._asked_s = reading.asked_s
        self.seen_deg = reading.angle_deg
        if self._course is not None:
            self._course.add(reading)
        return status, reading

    def _ask(self) -> tuple[StageStatus, StageReading]:
        asked_s = self._clock.now_s()
        status = self._logic.read()
        since_s = asked_s if status.since_s is None else status.since_s
        return status, StageReading(angle_deg=status.angle_deg, asked_s=since_s, answered_s=self._clock.now_s())

    def go(self, target_deg: float, start_deg: float) -> float:
        """Go from one angle to another, and return the angle at which it came to rest.

        Raises `MoveError` or `LimitError` as `look` says, and if it does not begin, does not go on, or stops elsewhere.
        """
        rules = self._rules
        heading = 1 if target_deg > start_deg else -1
        self.begin(target_deg, start_deg)
        longest_s = rules.longest_s(abs(target_deg - start_deg))
        aimed_s = advanced_s = looked_s = began_s = self._clock.now_s()
        ends_s = began_s + longest_s
        pause_s = 0.0
        aim_deg: float | None = None
        sent_s: float | None = math.inf
        farthest_deg = farthest_aim_deg = start_deg
        settled: list[float] = []
        while True:
            status, reading = self.look_dated()
            now_s = self._clock.now_s()
            # A target that is renewed late costs the stage that time twice: it brakes, and speeds up again.
            late_s = now_s - looked_s - pause_s
            ends_s = min(ends_s + 2 * late_s, began_s + _MAX_TIMES * longest_s)
            looked_s = now_s
            if self._settles(status, target_deg, settled):
                return status.angle_deg
            if heading * (status.angle_deg - farthest_deg) > rules.same_deg:
                farthest_deg = status.angle_deg
                advanced_s = reading.answered_s
            if sent_s is not None and reading.asked_s >= sent_s:
                # Only now has it surely received its target: both may have waited in one place on their way.
                sent_s = None
                advanced_s = reading.answered_s
            near = abs(target_deg - status.angle_deg) <= rules.settle_deg
            patience_s = rules.begin_s + (_SETTLES_S if near else 0.0)
            if sent_s is None and not settled and not reading.asked_s - advanced_s < patience_s:
                raise self._stuck(status, target_deg, began=farthest_deg != start_deg, aim_deg=aim_deg)
            if not now_s < ends_s:
                raise MoveError(f"the stage has not arrived in {now_s - began_s:.1f} s; it is too slow")
            if now_s - aimed_s >= _RENEW_S - _TICK_S or aim_deg is None:
                # The nearer of two readings: a garbled reading must not carry the target further.
                here_deg = min(status.angle_deg, self.look().angle_deg, key=lambda angle_deg: heading * angle_deg)
                next_deg = self.ahead_deg(target_deg, here_deg, heading)
                if next_deg != aim_deg or not (status.moving or settled):
                    self.aim(next_deg)
                if heading * (next_deg - farthest_aim_deg) > rules.same_deg:
                    # At the target before it may have come to rest, if this one is late.
                    farthest_aim_deg = next_deg
                    sent_s = self._clock.now_s()
                aim_deg = next_deg
                aimed_s = now_s
            pause_s = self._pause_s(abs(target_deg - status.angle_deg))
            self._clock.wait(pause_s)

    def begin(self, target_deg: float, start_deg: float, *, evenly: bool = False) -> None:
        """Take every reading from now on as one on the way from one angle to another; nothing moves yet.

        ``evenly``: whether it will get this one target only, and so turns evenly between its ramps.
        """
        self._corridor = (min(start_deg, target_deg), max(start_deg, target_deg))
        self._asked_s = self._clock.now_s()
        self.seen_deg = start_deg
        self._from_deg = start_deg
        self._begun_s = None
        if self._rules.acceleration_deg_s2 is not None:
            self._course = Course(
                start_deg=start_deg,
                target_deg=target_deg,
                now_s=self._clock.now_s(),
                acceleration_deg_s2=_TOO_FAST * self._rules.acceleration_deg_s2,
                unsteady_deg=self._rules.unsteady_deg,
                settle_deg=self._rules.settle_deg,
                speed_deg_s=self._rules.speed_deg_s if evenly else None,
            )

    def brake(self) -> None:
        """Take every reading from now on as one of a stage that may come to rest."""
        if self._course is not None:
            self._course.brakes = True

    def ahead_deg(self, target_deg: float, here_deg: float, heading: int) -> float:
        """Return the target, or the angle as far ahead as allowed."""
        # Less two steps of the readback, since the motor may be anywhere within the step that is read.
        lead_deg = MAX_AHEAD_DEG - 2 * self._rules.resolution_deg
        return target_deg if heading * (target_deg - here_deg) <= lead_deg else here_deg + heading * lead_deg

    def aim(self, angle_deg: float) -> None:
        """Give a target."""
        asked_s = self._clock.now_s()
        self._aim_deg = angle_deg
        if self._course is not None:
            self._course.aim(angle_deg)
        sent_at_s = self._logic.go(angle_deg)
        if self._begun_s is None:
            self._begun_s = asked_s if sent_at_s is None else sent_at_s

    def _settles(self, status: StageStatus, target_deg: float, settled: list[float]) -> bool:
        """Return whether it stands at the target for some readings in a row."""
        if status.moving or abs(status.angle_deg - target_deg) > self._rules.arrival_deg:
            settled.clear()
            return False
        settled.append(status.angle_deg)
        last = settled[-_STABLE_READS:]
        return len(last) == _STABLE_READS and max(last) - min(last) <= self._rules.same_deg

    def _pause_s(self, left_deg: float) -> float:
        return min(_POLL_S, max(_NEAR_POLL_S, left_deg / self._rules.speed_deg_s))

    def _objection(self, status: StageStatus, reading: StageReading) -> DeviceError | None:
        spare_deg = self._rules.unexpected_deg
        angle_deg = status.angle_deg
        if status.problem:
            return MoveError(status.problem)
        if not self._travel.low_deg - spare_deg <= angle_deg <= self._travel.high_deg + spare_deg:
            return LimitError(
                f"the stage has left its travel range {self._travel}, by its reading of {angle_deg:.3f} deg"
                f"{self._doubt(angle_deg)}"
            )
        low_deg, high_deg = self._corridor
        if not low_deg - spare_deg <= angle_deg <= high_deg + spare_deg:
            return MoveError(
                f"the stage is at {angle_deg:.3f} deg, which is not on its way from {low_deg:.3f} to {high_deg:.3f} "
                f"deg; did somebody turn its wheel, or does another program use it?{self._doubt(angle_deg)}"
            )
        said = self._too_fast(angle_deg) or ("" if self._course is None else self._course.objection(reading))
        return MoveError(said) if said else None

    def _too_fast(self, angle_deg: float) -> str:
        """Return why it cannot have got there by now, at the speed and acceleration that were set; empty if it can.

        The times are the longest that it can have turned, however slow the line is: from before it was asked last, or
        sent on its way, until now. That a stage stands where it was sent is thereby not believed before it can be so.
        """
        rules = self._rules
        now_s = self._clock.now_s()
        ways: list[tuple[float, float, float]] = []
        if self.seen_deg is not None:
            turned_s = now_s - self._asked_s
            swing_deg = 0.0 if self._course is None else self._course.swing_deg(self.seen_deg, angle_deg)
            ways.append((self.seen_deg, turned_s, max(_TOO_FAST * rules.speed_deg_s * turned_s, swing_deg)))
        if self._from_deg is not None:
            turned_s = 0.0 if self._begun_s is None else now_s - self._begun_s
            swing_deg = 0.0
            if self._course is not None and self._course.sweeps:
                # A sweep begins where the servo may still swing, as at its turn.
                swing_deg = self._course.swing_deg(self._from_deg, angle_deg)
            ways.append((self._from_deg, turned_s, max(rules.reach_deg(turned_s), swing_deg)))
        for start_deg, turned_s, most_deg in ways:
            if not abs(angle_deg - start_deg) <= most_deg + rules.unsteady_deg:
                return (
                    f"the stage went from {start_deg:.3f} to {angle_deg:.3f} deg in {turned_s:.3f} s, faster than it "
                    "was set to; switch it off and on, home it with the probe outside the patient"
                    f"{self._doubt(angle_deg)}"
                )
        return ""

    def _doubt(self, angle_deg: float) -> str:
        """Return the end of an error: the unit or sign that explains why a stage is where it cannot be."""
        if self._from_deg is None or self._aim_deg is None:
            return ""
        doubt = unit_doubt(self._aim_deg, angle_deg)
        if doubt:
            return doubt
        turned_deg = angle_deg - self._from_deg
        asked_deg = self._aim_deg - self._from_deg
        if turned_deg * asked_deg < 0:
            return "; it turned the other way: if it does so again, the signs of read() and go() differ (-1 x)"
        turned_s = self._clock.now_s() - (self._clock.now_s() if self._begun_s is None else self._begun_s)
        times = abs(turned_deg) / max(min(abs(asked_deg), self._rules.reach_deg(turned_s)), self._rules.same_deg)
        if times < _OFF_SCALE:
            return ""
        return f"; the reading grows {times:.0f} x or more as fast as was asked: are read() and go() in degrees?"

    @staticmethod
    def _stuck(status: StageStatus, target_deg: float, *, began: bool, aim_deg: float | None) -> MoveError:
        what = "came to rest" if began else "did not begin to move"
        doubt = unit_doubt(aim_deg or 0.0, status.angle_deg)
        if began and aim_deg and not doubt and not 0.9 < status.angle_deg / aim_deg < 1.1:
            doubt = f", or for another unit: the reading is {status.angle_deg / aim_deg:.3g} x what was asked"
        return MoveError(
            f"the stage {what} at {status.angle_deg:.3f} deg, {abs(target_deg - status.angle_deg):.3f} deg from its "
            f"target; {status.cure}{doubt}"
        )
