"""Simulated rigs with frames, as they are assembled."""

from __future__ import annotations

import pytest

from markerseek.rigs import simulated
from markerseek.sim import ReceiverSettings, SimulatedSettings


@pytest.mark.parametrize("data", ["channels", "b-mode"])
def test_a_rig_calls_its_beat_while_a_device_works(data: str) -> None:
    """Through it `ros2 sim` hears its messages; on a rig in B-mode it heard none."""
    beats: list[str] = []
    settings = SimulatedSettings(receiver=ReceiverSettings(data=data))  # type: ignore[arg-type]
    rig = simulated(seed=1, settings=settings, beat=lambda: beats.append(data))
    rig.scanner.measure(5.0)
    assert beats
