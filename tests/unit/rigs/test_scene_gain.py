"""The gain that a simulated receiver chooses: single pulses, as in a sweep, have more noise than an average."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from markerseek.rigs import draw_scene
from markerseek.sim import SimulatedSettings


@pytest.mark.parametrize("snr_db", [15.0, 25.0, 40.0])
def test_single_pulses_stay_below_full_scale(snr_db: float) -> None:
    settings = SimulatedSettings()
    settings = replace(settings, noise=replace(settings.noise, peak_snr_db=snr_db))
    single = replace(settings, receiver=replace(settings.receiver, single_pulses=True))
    average, one = (draw_scene(each, np.random.default_rng(1)) for each in (settings, single))
    # The SNR is the same, whatever the gain.
    assert one.peak / one.noise.white_sigma == pytest.approx(average.peak / average.noise.white_sigma)
    assert one.peak_counts + 6 * 4 * one.noise.white_sigma <= 2047
    assert one.peak_counts <= average.peak_counts
