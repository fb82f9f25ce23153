"""Simulated rigs with frames, as they are assembled."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek.drivers import bench_settings_from
from markerseek.rigs import bench, draw_scene, simulated
from markerseek.sim import SimulatedSettings


def test_a_rig_calls_its_beat_while_a_device_works() -> None:
    """Through it `ros2 sim` hears its messages."""
    beats: list[str] = []
    rig = simulated(seed=1, beat=lambda: beats.append("a beat"))
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


@pytest.mark.parametrize("snr_db", [15.0, 25.0, 40.0])
def test_single_pulses_stay_below_full_scale(snr_db: float) -> None:
    """Of the gain that the receiver chooses: single pulses, as in a sweep, have more noise than an average."""
    settings = SimulatedSettings()
    settings = structs.replace(settings, noise=structs.replace(settings.noise, peak_snr_db=snr_db))
    single = structs.replace(settings, receiver=structs.replace(settings.receiver, single_pulses=True))
    average, one = (draw_scene(each, np.random.default_rng(1)) for each in (settings, single))
    # The SNR is the same, whatever the gain.
    assert one.peak / one.noise.white_sigma == pytest.approx(average.peak / average.noise.white_sigma)
    assert one.peak_counts + 6 * 4 * one.noise.white_sigma <= 2047
    assert one.peak_counts <= average.peak_counts
