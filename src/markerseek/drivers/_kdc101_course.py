"""Readings of a stage on its way: it does not turn back, and changes its speed no faster than it was set to.

An encoder that jumps in mid-move shows itself here: backwards as a fall-back, or either way as a speed that no motor
with the acceleration that was set can have. Each reading was taken at some time between the question and its answer;
every bound below takes the ends of these times that speak for the stage. What holds up the computer, the line or the
answers widens these times and with them the bounds: it hides small jumps, and makes no jump of a sound stage. Pure.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from markerseek.core import MoveError

_APART_S = 0.015
"""Readings closer together than this tell nothing of the speed."""
_KEPT = 6
"""Readings that are compared with: a short way back the speed is recent, a long way back it is well known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DatedPosition:
    """A position in counts, and the earliest and latest time at which it can have been taken, in seconds."""

    counts: int
    asked_s: float
    answered_s: float


class Course:
    """The readings of one move from rest, in one direction.

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
