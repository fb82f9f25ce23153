"""One move of the stage: a target that is renewed, and all that is asked of it on its way.

A stage on its way does not turn back, and changes its speed no faster than it was set to (`Course`). An encoder that
jumps in mid-move shows itself there: backwards as a fall-back, or either way as a speed that no motor with the
acceleration that was set can have.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Self

from markerseek.core import Clock, DeviceError, LimitError, MoveError, require_range
from markerseek.drivers._apt_line import AptLine
from markerseek.wire import apt

_POLL_S = 0.05
_NEAR_POLL_S = 0.02
_STABLE_READS = 3
_STABLE_COUNTS = 2
_TRIES = 3
_TICK_S = 1e-6
_MAX_TIMES = 5
"""On a computer that is held up, a move may take so many times as long."""
_TOO_FAST = 1.25
"""Share of speed and acceleration set that is put down to the servo and to the age of two readings."""
_UNSTEADY_COUNTS = 20
"""How far a servo may be ahead of its set point, at any speed: 0.01 deg."""
_APART_S = 0.015
"""Readings closer together than this give no speed."""
DISABLED = "its channel is disabled, and its motor gets no current: arming the rig enables it"
_KEPT = 6
"""Readings that are compared with: a short way back the speed is recent, a long way back it is well known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Kdc101Moves:
    """How a move is made and checked, which no rig file changes."""

    lead_deg: float = 5.0
    renew_s: float = 0.1
    """``lead_deg`` and ``renew_s``: how far ahead a target may be, in degrees, and how often it is renewed, in
    seconds."""
    arrival_deg: float = 0.01
    """Largest distance from its target at which the stage counts as arrived."""
    unexpected_deg: float = 0.2
    """Largest distance from where it should be on its way, and at rest."""
    answer_s: float = 0.1
    """Time for an answer before the request is repeated."""

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("lead_deg", 0.5, 5, "deg"),
            ("renew_s", 0.02, 0.5, "s"),
            ("arrival_deg", 0.001, 0.1, "deg"),
            ("unexpected_deg", 0.05, 1, "deg"),
            ("answer_s", 0.01, 1, "s"),
        ):
            require_range(f"stage: {name}", getattr(self, name), low=low, high=high, unit=unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveRules:
    """What a move may do; lengths in counts, speeds in counts per second."""

    low: int
    high: int
    """``low`` and ``high``: travel range."""
    speed: float
    acceleration: float
    """``speed`` and ``acceleration``: how it moves, by what it keeps."""
    lead: int
    renew_s: float
    """``lead`` and ``renew_s``: how far ahead a target may be, and how often it is renewed."""
    arrival: int
    """How near to the target it must come."""
    unexpected: int
    """How far it may be from where it should be."""
    begin_s: float
    """How long it may stand still on its way."""

    @classmethod
    def of(cls, moves: Kdc101Moves, *, limits: apt.SoftLimits, velocity: apt.Velocity, begin_s: float) -> Self:
        """The rules of a controller with these limits, and this velocity."""
        return cls(
            low=limits.low,
            high=limits.high,
            # As rounded to the controller's words, not as set: small accelerations are off by up to a third.
            speed=counts_per_s(velocity),
            acceleration=velocity.acceleration / apt.ACCELERATION_WORD * apt.COUNTS_PER_DEG,
            # One count less, since the motor may be anywhere within the count that is read.
            lead=math.floor(moves.lead_deg * apt.COUNTS_PER_DEG) - 1,
            renew_s=moves.renew_s,
            arrival=round(moves.arrival_deg * apt.COUNTS_PER_DEG),
            unexpected=round(moves.unexpected_deg * apt.COUNTS_PER_DEG),
            begin_s=begin_s,
        )

    def longest_s(self, distance: int) -> float:
        """Longest time that a move of that length may take, in seconds."""
        return 2 * (distance / self.speed + self.speed / self.acceleration) + 2 * self.begin_s

    def reach(self, duration_s: float) -> float:
        """Farthest that a motor gets from rest in that time, in counts, with what it may exceed its settings by."""
        speeding_s = min(duration_s, self.speed / self.acceleration)
        return _TOO_FAST * (self.acceleration * speeding_s**2 / 2 + self.speed * (duration_s - speeding_s))


def counts_per_s(velocity: apt.Velocity) -> float:
    """Speed in counts per second."""
    return velocity.speed / apt.SPEED_WORD * apt.COUNTS_PER_DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class DatedPosition:
    """A position in counts, and the earliest and latest time at which it can have been taken, in seconds."""

    counts: int
    asked_s: float
    answered_s: float


class Course:
    """The readings of one move from rest, in one direction.

    Each reading was taken at some time between the question and its answer; every bound takes the ends of these times
    that speak for the stage. What holds up the computer, the line or the answers widens these times and with them the
    bounds: it hides small jumps, and makes no jump of a sound stage.

    ``start``: where it stands, in counts. ``heading``: 1 for upwards, -1 for downwards. ``acceleration``: largest
    acceleration, in counts per second squared, with what a motor may exceed its setting by. ``unsteady``: how far a
    servo may be off the way that it was set, in counts: noise of the encoder, and settling at the end.
    """

    def __init__(self, *, start: int, heading: int, now_s: float, acceleration: float, unsteady: int) -> None:
        self._heading = heading
        self._acceleration = acceleration
        self._unsteady = unsteady
        self._farthest = start
        self._last: deque[DatedPosition] = deque(
            [DatedPosition(counts=start, asked_s=now_s, answered_s=now_s)], maxlen=_KEPT
        )

    def objection(self, reading: DatedPosition) -> MoveError | None:
        """Why a stage on this course cannot be there; None if it can."""
        back = self._heading * (self._farthest - reading.counts)
        if back > self._unsteady:
            return MoveError(
                f"the stage fell back by {back} counts on its way, to {reading.counts}; its encoder or its coupling "
                "slips: switch it off and on, home it with the probe outside the patient"
            )
        if len(self._last) < 2:
            return None
        *earlier, last = self._last
        bounds = [self._advances(first, last, reading) for first in earlier]
        low, high = max(low for low, _ in bounds), min(high for _, high in bounds)
        advance = self._heading * (reading.counts - last.counts)
        if low <= advance <= high:
            return None
        return MoveError(
            f"the stage advanced by {advance} counts where its acceleration allows {low:.0f} to {high:.0f}; its "
            "encoder jumped, or its motor slips: switch it off and on, home it with the probe outside the patient"
        )

    def _advances(self, first: DatedPosition, second: DatedPosition, third: DatedPosition) -> tuple[float, float]:
        """Least and largest advance from the second reading to the third, by the speed between the first two."""
        advance = self._heading * (second.counts - first.counts)
        change = self._acceleration * (third.answered_s - first.asked_s)
        slowest = (advance - self._unsteady) / (second.answered_s - first.asked_s) - change
        fastest = (advance + self._unsteady) / max(second.asked_s - first.answered_s, 1e-3) + change
        low = max(slowest, 0.0) * max(third.asked_s - second.answered_s, 0.0) - self._unsteady
        return low, max(fastest, 0.0) * (third.answered_s - second.asked_s) + self._unsteady

    def add(self, reading: DatedPosition) -> None:
        """Add a reading that has passed all checks."""
        if self._heading * (reading.counts - self._farthest) > 0:
            self._farthest = reading.counts
        if reading.asked_s - self._last[-1].answered_s >= _APART_S:
            self._last.append(reading)


class Move:
    """A stage on its way, or at rest between two moves.

    ``rest``: where it stands, if it should not move; None if that is not known.
    """

    def __init__(self, *, line: AptLine, clock: Clock, rules: MoveRules, rest: int | None = None) -> None:
        self._line = line
        self._clock = clock
        self._rules = rules
        self._corridor = (rules.low, rules.high) if rest is None else (rest, rest)
        self._last: tuple[float, int] | None = None
        self._course: Course | None = None
        self._from: int | None = None
        self._begun_s: float | None = None

    @property
    def seen(self) -> int | None:
        """Position of the last reading, in counts; None before the first."""
        return None if self._last is None else self._last[1]

    def look(self) -> apt.Status:
        """Status that is what it can be; a suspicious one is asked for again, since a garbled one does not come twice.

        Raises `MoveError` if it reports an error, was switched off, homes, fell back on its way, or is where it cannot
        be. Raises `LimitError` if it is outside its travel range.
        """
        return self.look_dated()[0]

    def look_dated(self) -> tuple[apt.Status, DatedPosition]:
        """As `look`, with the times between which it was taken."""
        status, reading = self._ask()
        if self._objection(status, reading) is not None:
            status, reading = self._ask()
            objection = self._objection(status, reading)
            if objection is not None:
                raise objection
        self._last = (reading.asked_s, reading.counts)
        if self._course is not None:
            self._course.add(reading)
        return status, reading

    def _ask(self) -> tuple[apt.Status, DatedPosition]:
        status = self._line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status)
        answered_s = self._clock.now_s()
        return status, DatedPosition(counts=status.position, asked_s=self._line.since_s, answered_s=answered_s)

    def go(self, target: int, start: int) -> int:
        """Go from a place to another, and return where it came to rest, all in counts.

        Raises `MoveError` or `LimitError` as `look` says, and if it does not begin, does not go on, or stops elsewhere.
        """
        rules = self._rules
        heading = 1 if target > start else -1
        self.begin(target, start)
        longest_s = rules.longest_s(abs(target - start))
        aimed_s = advanced_s = looked_s = began_s = self._clock.now_s()
        ends_s, pause_s = began_s + longest_s, 0.0
        aim: int | None = None
        sent_s: float | None = math.inf
        farthest = farthest_aim = start
        settled: list[int] = []
        while True:
            status, reading = self.look_dated()
            now_s = self._clock.now_s()
            # A target that is renewed late costs the stage that time twice: it brakes, and speeds up again.
            late_s = now_s - looked_s - pause_s
            ends_s, looked_s = min(ends_s + 2 * late_s, began_s + _MAX_TIMES * longest_s), now_s
            if self._settles(status, target, settled):
                return status.position
            if heading * (status.position - farthest) > _STABLE_COUNTS:
                farthest, advanced_s = status.position, reading.answered_s
            if sent_s is not None and reading.asked_s >= sent_s:
                # Only now has it surely received its target: both may have waited in one place on their way.
                sent_s, advanced_s = None, reading.answered_s
            if sent_s is None and not settled and not reading.asked_s - advanced_s < rules.begin_s:
                raise self._stuck(status, target, began=farthest != start)
            if not now_s < ends_s:
                raise MoveError(f"the stage has not arrived in {now_s - began_s:.1f} s; it is too slow")
            if now_s - aimed_s >= rules.renew_s - _TICK_S or aim is None:
                # The nearer of two readings: one that is garbled must not carry the target further.
                here = min(status.position, self.look().position, key=lambda position: heading * position)
                next_aim = target if heading * (target - here) <= rules.lead else here + heading * rules.lead
                if next_aim != aim or not (status.moving or settled):
                    self.aim(next_aim)
                if heading * (next_aim - farthest_aim) > _STABLE_COUNTS:
                    # At the target before it may have come to rest, if this one is late.
                    farthest_aim, sent_s = next_aim, self._clock.now_s()
                aim, aimed_s = next_aim, now_s
            pause_s = self._pause_s(abs(target - status.position))
            self._clock.wait(pause_s)

    def begin(self, target: int, start: int) -> None:
        """Take every reading from now on as one on the way from a place to another, in counts; nothing moves yet."""
        self._corridor = (min(start, target), max(start, target))
        self._last = (self._clock.now_s(), start)
        self._from, self._begun_s = start, None
        self._course = Course(
            start=start,
            heading=1 if target > start else -1,
            now_s=self._clock.now_s(),
            acceleration=_TOO_FAST * self._rules.acceleration,
            unsteady=max(self._rules.arrival, _UNSTEADY_COUNTS),
        )

    def aim(self, counts: int) -> None:
        """Give a target, and let it go there only once the controller is known to have understood it."""
        for _ in range(_TRIES):
            question = apt.set_target(counts) + apt.ask(apt.TARGET)
            if self._line.ask(question, apt.TARGET, apt.Counts).counts == counts:
                if self._begun_s is None:
                    self._begun_s = self._clock.now_s()
                self._line.send(apt.move())
                return
        raise MoveError(f"the stage did not take the target {counts} counts in {_TRIES} tries; check its cable")

    def _settles(self, status: apt.Status, target: int, settled: list[int]) -> bool:
        """Whether it stands at the target for some readings in a row."""
        if status.moving or abs(status.position - target) > self._rules.arrival:
            settled.clear()
            return False
        settled.append(status.position)
        last = settled[-_STABLE_READS:]
        return len(last) == _STABLE_READS and max(last) - min(last) <= _STABLE_COUNTS

    def _pause_s(self, left: int) -> float:
        return min(_POLL_S, max(_NEAR_POLL_S, left / self._rules.speed))

    def _objection(self, status: apt.Status, reading: DatedPosition) -> DeviceError | None:
        rules = self._rules
        if status.faults:
            return MoveError(f"the stage reports: {', '.join(status.faults)}; look for an obstacle")
        if not status.homed or status.homing:
            return MoveError(
                "the stage is not homed any more: it lost power, or was told to home; take the probe out of the "
                "patient and home it by the controller's menu"
            )
        if not rules.low - rules.unexpected <= status.position <= rules.high + rules.unexpected:
            return LimitError(f"the stage has left its travel range, by its reading of {status.position} counts")
        low, high = self._corridor
        if not low - rules.unexpected <= status.position <= high + rules.unexpected:
            return MoveError(
                f"the stage is at {status.position} counts, which is not on its way from {low} to {high}; did somebody "
                "turn its wheel, or does another program use it?"
            )
        too_fast = self._too_fast(status.position)
        return too_fast if too_fast is not None or self._course is None else self._course.objection(reading)

    def _too_fast(self, position: int) -> MoveError | None:
        """Whether it cannot have got there by now, at the speed and acceleration that were set.

        The times are the longest that it can have turned, however slow the line is: from before it was asked last, or
        sent on its way, until now. That a stage stands where it was sent is thereby not believed before it can be so.
        """
        now_s = self._clock.now_s()
        ways: list[tuple[int, float, float]] = []
        if self._last is not None:
            last_s, last = self._last
            ways.append((last, now_s - last_s, _TOO_FAST * self._rules.speed * (now_s - last_s)))
        if self._from is not None:
            turned_s = 0.0 if self._begun_s is None else now_s - self._begun_s
            ways.append((self._from, turned_s, self._rules.reach(turned_s)))
        for start, turned_s, most in ways:
            if not abs(position - start) <= most + max(self._rules.arrival, _UNSTEADY_COUNTS):
                return MoveError(
                    f"the stage went from {start} to {position} counts in {turned_s:.3f} s, faster than it was set to; "
                    "switch it off and on, home it with the probe outside the patient"
                )
        return None

    def _stuck(self, status: apt.Status, target: int, *, began: bool) -> MoveError:
        what = "came to rest" if began else "did not begin to move"
        cure = "look for an obstacle" if status.enabled else DISABLED
        return MoveError(
            f"the stage {what} at {status.position} counts, "
            f"{abs(target - status.position) / apt.COUNTS_PER_DEG:.3f} deg from its target; {cure}"
        )
