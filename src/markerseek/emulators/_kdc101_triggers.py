"""Trigger port 1 of an emulated KDC101: rising edges by position. Its modes by motion and speed are not emulated."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from markerseek.wire import apt

PORTS, POSITIONS = 0x0523, 0x0526
"""Messages that set what the ports do, and where."""

POWER_UP = {PORTS: struct.pack("<6H", 1, 0, 1, 0, 1, 0), POSITIONS: struct.pack("<H8i", 1, *[0] * 8)}

_ACTIVE_HIGH = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """A rising edge: its time in seconds, and the true angle of the probe in degrees."""

    at_s: float
    angle_deg: float


class TriggerOutput:
    """Gives edges while the stage turns; `look` must be called in small steps while it is `armed`."""

    def __init__(self) -> None:
        self.edges: list[Edge] = []
        self.set(POWER_UP)

    @property
    def armed(self) -> bool:
        """Whether it may give an edge."""
        return bool(self._left)

    def set(self, stored: dict[int, bytes]) -> None:
        """Take over the mode, and only with it the positions, as they were written before."""
        _channel, mode, polarity, *_ = struct.unpack("<6H", stored[PORTS])
        _channel, *rows, pulse_us, _cycles = struct.unpack("<H8i", stored[POSITIONS])
        self._late_s = 0.0 if polarity == _ACTIVE_HIGH else pulse_us * 1e-6
        self._sign = -1 if mode == apt.TRIGGER_STEPS_DOWN else 1
        self._next, self._step, self._left = rows[:3] if self._sign > 0 else rows[3:]
        if mode not in (apt.TRIGGER_STEPS_UP, apt.TRIGGER_STEPS_DOWN):
            self._left = 0
        self._last: tuple[float, float, float] | None = None

    def look(self, *, at_s: float, counts: float, angle_deg: float) -> None:
        """Note where motor and probe are then, and give the edges since the last look."""
        before, self._last = self._last, (at_s, counts, angle_deg)
        if before is None:
            return
        before_s, before_counts, before_deg = before
        while self._left and self._sign * before_counts < self._sign * self._next <= self._sign * counts:
            share = (self._next - before_counts) / (counts - before_counts)
            self.edges.append(
                Edge(
                    at_s=before_s + share * (at_s - before_s) + self._late_s,
                    angle_deg=before_deg + share * (angle_deg - before_deg),
                )
            )
            self._next, self._left = self._next + self._sign * self._step, self._left - 1

    def taken(self, until_s: float) -> list[Edge]:
        """Edges until that time that were not taken before."""
        due = [edge for edge in self.edges if edge.at_s <= until_s]
        del self.edges[: len(due)]
        return due
