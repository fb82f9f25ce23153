"""By how much the stamps of a position-triggered sweep differ from its triggers."""

from __future__ import annotations

import pytest

from markerseek.core import Pulse, Triggers
from markerseek.scan.sweeping import StampedAngle, SweepInProgress


def stamp_offsets_deg(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A list that grows by the angle of each pulse's stamp minus that of its trigger, in degrees."""
    offsets_deg: list[float] = []
    triggered_deg = SweepInProgress._triggered_deg

    def noted(self: SweepInProgress, triggers: Triggers, pulse: Pulse, stamped: StampedAngle) -> float:
        angle_deg = triggered_deg(self, triggers, pulse, stamped)
        offsets_deg.append(stamped.angle_deg - angle_deg)
        return angle_deg

    monkeypatch.setattr(SweepInProgress, "_triggered_deg", noted)
    return offsets_deg
