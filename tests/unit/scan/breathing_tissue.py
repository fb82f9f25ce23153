"""Tissue that breathes by a table of times, and says so as cameras do: late, and as far as it knows."""

from __future__ import annotations

from dataclasses import dataclass, field

from markerseek.core import Clock, Displacement

STILL = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))


@dataclass
class BreathingTissue:
    """A saw: at rest for `pause_s` of each breath, then displaced along x by up to 2 mm."""

    clock: Clock
    breath_s: float | None = 4.0
    pause_s: float = 1.5
    known_after_s: float = 0.2
    unknown: tuple[float, float] = (0.0, 0.0)
    """From when until when nothing is known."""
    asked_s: list[float] = field(default_factory=list)

    def phase_s(self, at_s: float) -> float:
        """Time since the last pause began; the first one begins at 2.5 s."""
        return (at_s - 2.5) % (self.breath_s or 4.0)

    def rests(self, for_s: float) -> bool | None:
        """Whether the pause holds until then."""
        now_s = self.clock.now_s()
        if self.unknown[0] <= now_s < self.unknown[1]:
            return None
        return self.phase_s(now_s) + for_s <= self.pause_s

    def displacement(self, at_s: float) -> Displacement | None:
        """That of the saw; nobody asks before it is known."""
        assert at_s + self.known_after_s <= self.clock.now_s() + 1e-9
        self.asked_s.append(at_s)
        if self.unknown[0] <= at_s < self.unknown[1]:
            return None
        return Displacement(mm=(self.way_mm(at_s), 0.0, 0.0), covariance_mm2=STILL)

    def way_mm(self, at_s: float) -> float:
        """Displacement along x."""
        breathes_s = (self.breath_s or 4.0) - self.pause_s
        return 2.0 * max(0.0, self.phase_s(at_s) - self.pause_s) / breathes_s
