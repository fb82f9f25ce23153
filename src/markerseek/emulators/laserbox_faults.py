"""Faults of the emulated laser box, of its laser, photodiode, clock and trigger input."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True, kw_only=True)
class LaserBoxFaults:
    """Faults of the box; may be changed while it runs."""

    laser_dead: bool = False
    """Triggers are sent and no light comes."""
    photodiode_dead: bool = False
    """Light comes and is not seen."""
    extra_pulses: int = 0
    """Pulses beyond the permit that a broken counter lets through."""
    boot_s: float = 0.0
    """Time for which it is deaf, since it restarts when its port is opened: at the first bytes that it gets."""
    silent: bool = False
    """The box works and answers nothing."""
    light_late_us: int = 0
    """Time from a trigger to its light."""
    clock_drift: float = 0.0
    """By how much the clock of its stamps is fast, as a share."""
    clock_step_us: int = 0
    """By how much that clock is ahead."""
    doubled_at: int = 0
    """Number of the pulse of a sweep at which the laser gives two; 0: none."""
    edges_cut: bool = False
    """No edge reaches the trigger input."""
    edge_lost_at: int = 0
    edge_doubled_at: int = 0
    """``edge_lost_at`` and ``edge_doubled_at``: number of the edge of a sweep that does not reach the trigger input, or
    bounces; 0: none."""

    def times_seen(self, edge: int) -> int:
        """How often the edge of that number reaches the trigger input."""
        if self.edges_cut or edge == self.edge_lost_at:
            return 0
        return 2 if edge == self.edge_doubled_at else 1
