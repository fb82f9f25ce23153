"""By how much the stamps of a position-triggered sweep differ from its triggers."""

from __future__ import annotations

import pytest

from markerseek.core import Pulse
from markerseek.scan._pulse_angle import StampedAngle, TriggerCount


def stamp_offsets_deg(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A list that grows by the angle of each pulse's stamp minus that of its trigger, in degrees."""
    offsets_deg: list[float] = []
    triggered_deg = TriggerCount.angle_deg

    def noted(self: TriggerCount, pulse: Pulse, stamped: StampedAngle) -> float:
        angle_deg = triggered_deg(self, pulse, stamped)
        offsets_deg.append(stamped.angle_deg - angle_deg)
        return angle_deg

    monkeypatch.setattr(TriggerCount, "angle_deg", noted)
    return offsets_deg
