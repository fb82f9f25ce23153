"""Simulated rigs with frames, as they are assembled."""

from __future__ import annotations

import pytest

from markerseek.drivers import bench_settings_from
from markerseek.rigs import bench, simulated
from markerseek.sim import ReceiverSettings, SimulatedSettings


@pytest.mark.parametrize("data", ["channels", "b-mode"])
def test_a_rig_calls_its_beat_while_a_device_works(data: str) -> None:
    """Through it `ros2 sim` hears its messages; on a rig in B-mode it heard none."""
    beats: list[str] = []
    settings = SimulatedSettings(receiver=ReceiverSettings(data=data))  # type: ignore[arg-type]
    rig = simulated(seed=1, settings=settings, beat=lambda: beats.append(data))
    rig.scanner.measure(5.0)
    assert beats


def test_simulated_parts_of_a_bench_have_the_noise_of_as_many_pulses_as_they_average() -> None:
    """It was that of 16 pulses for any number of them, and for the single pulses of a sweep."""
    sigmas = []
    for pulses in (16, 1):
        parts = {
            "stage": {"driver": "simulated"},
            "laser": {"driver": "simulated", "pulses": pulses},
            "receiver": {"driver": "simulated", "readout_s": 0.0},
        }
        with bench(bench_settings_from(parts)) as rig:
            rig.arm(by="this test")
            sigmas.append(rig.scanner.measure(0.0).reading.noise_sigma)
    assert sigmas[1] / sigmas[0] == pytest.approx(4, rel=0.05)
