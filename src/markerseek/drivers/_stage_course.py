"""The readings of one move of a stage, each checked against those before it.

A stage on its way does not turn back, and changes its speed no faster than it was set to. An encoder that jumps in
mid-move shows itself there: backwards as a fall-back, or either way as a speed that no motor with the acceleration that
was set can have.
"""

from __future__ import annotations

from collections import deque

from markerseek.core import StageReading
from markerseek.drivers._even import Even
from markerseek.drivers._stage_rules import TOO_FAST

_APART_S = 0.015
"""Readings closer together than this give no speed."""

_KEPT = 6
"""Readings that are compared with: a short way back the speed is recent, a long way back it is well known."""


class Course:
    """The readings of one move from rest, in one direction.

    Each reading was taken at some time between the question and its answer; every bound takes the ends of these times
    that speak for the stage. What holds up the computer, the line or the answers widens these times and with them the
    bounds: it hides small jumps, and makes no jump of a sound stage.

    ``start_deg``, ``target_deg``: where it stands, and where it is to stand. ``now_s``: time at its start.
    ``acceleration_deg_s2``: largest acceleration, with what a motor may exceed its setting by. ``unsteady_deg``: how
    far a servo may be off its way, by noise of the encoder. ``settle_deg``: the same where it comes to rest, because it
    swings there until it settles. ``speed_deg_s``: speed at which it turns evenly between its ramps; None: it is given
    one target after the other.
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
        # 1 upwards, -1 downwards.
        self._heading = 1 if target_deg > start_deg else -1
        # Ends of the way, and targets at which it may stand in between, if the next one is late.
        self._ends_deg = (start_deg, target_deg)
        self._aims_deg: deque[float] = deque(maxlen=_KEPT)
        self._acceleration = acceleration_deg_s2
        self._least_unsteady_deg = unsteady_deg
        self._settle_deg = settle_deg
        self.brakes = False
        """Whether it may come to rest anywhere from now on."""
        self._speed_deg_s = speed_deg_s
        self._even = Even() if speed_deg_s is None else Even(slowest=1 / (TOO_FAST * speed_deg_s))
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
        ramp_deg = TOO_FAST**2 * self._speed_deg_s**2 / (2 * self._acceleration) + self._settle_deg
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
