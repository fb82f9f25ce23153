"""Trigger port 1 of an emulated KDC101: rising edges by position, while it moves, or at its full speed."""

from __future__ import annotations

import struct
from dataclasses import dataclass

PORTS, POSITIONS = 0x0523, 0x0526
"""Messages that set what the ports do, and where."""

POWER_UP = {PORTS: struct.pack("<6H", 1, 0, 1, 0, 1, 0), POSITIONS: struct.pack("<H8i", 1, *[0] * 8)}

_MOVING, _FULL_SPEED, _UP, _DOWN, _BOTH = 0x0B, 0x0C, 0x0D, 0x0E, 0x0F
_ACTIVE_HIGH = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A rising edge: its time in seconds, and the true angle of the probe in degrees."""

    at_s: float
    angle_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Look:
    at_s: float
    counts: float
    angle_deg: float
    level: bool


@dataclass(slots=True)
class _Row:
    """Positions that are left in one direction."""

    next: int
    step: int
    left: int


class TriggerOutput:
    """Gives edges while the stage turns; `look` must be called in small steps while it is `armed`."""

    def __init__(self) -> None:
        self.edges: list[Edge] = []
        self._rows: list[_Row] = []
        self._last: _Look | None = None
        self.set(POWER_UP)

    @property
    def armed(self) -> bool:
        """Whether it may give an edge."""
        return bool(self._mode)

    def set(self, stored: dict[int, bytes]) -> None:
        """Take over the mode, and only with it the positions, as they were written before."""
        _channel, self._mode, polarity, *_ = struct.unpack("<6H", stored[PORTS])
        _channel, *rows, pulse_us, _cycles = struct.unpack("<H8i", stored[POSITIONS])
        self._late_s = 0.0 if polarity == _ACTIVE_HIGH else pulse_us * 1e-6
        self._rows, self._last = [], None
        for mode, sign, (start, interval, number) in ((_UP, 1, rows[:3]), (_DOWN, -1, rows[3:])):
            if self._mode in (mode, _BOTH):
                self._rows.append(_Row(next=start, step=sign * interval, left=number))

    def look(self, *, at_s: float, counts: float, angle_deg: float, speed: float, full_speed: float) -> None:
        """Note where motor and probe are then, and give the edges since the last look."""
        level = speed != 0 if self._mode == _MOVING else abs(speed) >= 0.999 * full_speed
        now, before = _Look(at_s=at_s, counts=counts, angle_deg=angle_deg, level=level), self._last
        self._last = now
        if before is None:
            return
        if self._mode in (_MOVING, _FULL_SPEED) and level and not before.level:
            self._give(before, now, share=1.0)
        for row in self._rows:
            sign = 1 if row.step > 0 else -1
            while row.left and sign * before.counts < sign * row.next <= sign * counts:
                self._give(before, now, share=(row.next - before.counts) / (counts - before.counts))
                row.next, row.left = row.next + row.step, row.left - 1

    def taken(self, until_s: float) -> list[Edge]:
        """Edges until that time that were not taken before."""
        due = [edge for edge in self.edges if edge.at_s <= until_s]
        del self.edges[: len(due)]
        return due

    def _give(self, before: _Look, now: _Look, *, share: float) -> None:
        at_s = before.at_s + share * (now.at_s - before.at_s) + self._late_s
        self.edges.append(Edge(at_s=at_s, angle_deg=before.angle_deg + share * (now.angle_deg - before.angle_deg)))
