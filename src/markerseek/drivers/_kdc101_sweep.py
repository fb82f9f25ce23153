"""One sweep of the stage: it turns from rest to rest, and gets a target that is some degrees ahead at each reading."""

from __future__ import annotations

from markerseek.core import Clock
from markerseek.drivers._apt_line import AptLine
from markerseek.drivers._kdc101_move import DatedPosition, Move, MoveRules
from markerseek.wire import apt

_PROMPT_S = 0.02
"""Time of an answer from which on the stage is asked once more: it turns by a quarter of a degree meanwhile."""


class SweepMove:
    """A stage that sweeps; making one begins to turn it.

    ``rules``: with the speed of the sweep. ``target``, ``start``: where it ends and where it stands, in counts.
    """

    def __init__(self, *, line: AptLine, clock: Clock, rules: MoveRules, target: int, start: int) -> None:
        self.move = Move(line=line, clock=clock, rules=rules)
        self.start = self.position = start
        self._line = line
        self._rules = rules
        self._target = target
        self._heading = 1 if target > start else -1
        self._aim: int | None = None
        self._braking = False
        self.move.begin(target, start)
        self._read_s = clock.now_s()
        self._aim_from(start, moving=False)

    @property
    def heading(self) -> int:
        """1 if the stage's own reading grows, -1 if it falls."""
        return self._heading

    def read(self) -> DatedPosition:
        """Where it is, checked as in a move; gives it its next target, unless it brakes.

        Raises `MoveError` or `LimitError` as `Move.look`.
        """
        status, reading = self.move.look_dated()
        if reading.answered_s - reading.asked_s > _PROMPT_S:
            status, reading = self.move.look_dated()
        if self._braking:
            # Sent again: without a checksum, a damaged stop is ignored and nobody reports it.
            self._line.send(apt.stop(profiled=True))
        else:
            # No farther than its speed can have carried it: a garbled reading must not carry the target further.
            most = self.position + self._heading * self._rules.speed * (reading.answered_s - self._read_s)
            here = min(reading.counts, round(most), key=lambda counts: self._heading * counts)
            self._aim_from(here, moving=status.moving)
        self.position, self._read_s = reading.counts, reading.asked_s
        return reading

    def brake(self) -> None:
        """Begin to brake, with the deceleration that was set."""
        self._braking = True
        self._line.send(apt.stop(profiled=True))

    def _aim_from(self, here: int, *, moving: bool) -> None:
        """Give the target that is as far ahead as allowed; the same one again to a stage that has not begun."""
        left = self._heading * (self._target - here)
        aim = self._target if left <= self._rules.lead else here + self._heading * self._rules.lead
        if aim != self._aim or (not moving and left > self._rules.arrival):
            self._aim = aim
            self.move.aim(aim)
