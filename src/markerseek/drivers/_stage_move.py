"""One move of a stage: a target that is renewed, and the checks of all that the stage says on its way."""

from __future__ import annotations

import math

from markerseek.core import (
    MAX_AHEAD_DEG,
    Clock,
    DeviceError,
    Interval,
    LimitError,
    MoveError,
    StageReading,
)
from markerseek.drivers._stage_course import Course
from markerseek.drivers._stage_rules import RENEW_S, TOO_FAST, StageLogic, StageRules, StageStatus
from markerseek.drivers._unit_doubt import unit_doubt

_OFF_SCALE = 5.0
"""Ratio of a way to the longest possible one from which on its unit is doubted."""

_POLL_S = 0.05
"""Time between two readings on the way, in seconds."""

_NEAR_POLL_S = 0.02
"""Least time between two readings near the target, in seconds."""

_STABLE_READS = 3
"""Readings in a row that must agree at the target."""

_SETTLES_S = 0.5
"""Time in which a servo settles at the end of a move, in seconds."""

_TICK_S = 1e-6
"""Rounding of the times of a clock, in seconds."""

_MAX_TIMES = 5
"""Multiple of its usual longest time that a move may take on a computer that is held up."""


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
        aimed_s = self._clock.now_s()
        advanced_s = aimed_s
        looked_s = aimed_s
        began_s = aimed_s
        ends_s = began_s + longest_s
        pause_s = 0.0
        aim_deg: float | None = None
        sent_s: float | None = math.inf
        farthest_deg = start_deg
        farthest_aim_deg = start_deg
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
            if now_s - aimed_s >= RENEW_S - _TICK_S or aim_deg is None:
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
                acceleration_deg_s2=TOO_FAST * self._rules.acceleration_deg_s2,
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
            ways.append((self.seen_deg, turned_s, max(TOO_FAST * rules.speed_deg_s * turned_s, swing_deg)))
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
