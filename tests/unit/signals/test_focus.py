"""Coherence at the best focus: of points, of several at once, at a wrong speed of sound, in noise."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek.signals import PRESET_NAMES, probe_preset
from markerseek.signals._kernel import PAD, aligned_energies
from markerseek.signals.filtering import band_pass
from markerseek.signals.focus import focused_coherence
from tests.unit.signals.pulse_frames import pulse_frame

BPL = probe_preset("BPL9-5/55")
WHITE = 5.0
"""Noise of a channel in counts, of which the filter leaves about a half."""


def counts(clean):
    return np.rint(clean).astype(np.int16)


def signals_of(samples, preset=BPL):
    return band_pass(samples, preset)


def coherence(samples, *, preset=BPL, lateral_m=4e-3, depth_m=0.04, intensity=1e4, sigma=0.0):
    signals = signals_of(samples, preset)
    return focused_coherence(signals, preset, lateral_m=lateral_m, depth_m=depth_m, intensity=intensity, sigma=sigma)


def point(lateral_m, depth_m, *, share=1000.0, preset=BPL):
    return share * pulse_frame(preset, lateral_m=lateral_m, depth_m=depth_m)


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_a_point_is_in_phase(name):
    preset = probe_preset(name)
    assert coherence(counts(point(4e-3, 0.04, preset=preset)), preset=preset) > 0.99


@pytest.mark.parametrize(("speed", "trigger_offset_s"), [(1450.0, 0.9e-6), (1600.0, -0.9e-6)])
def test_a_point_is_in_phase_at_a_wrong_speed_of_sound(speed, trigger_offset_s):
    """The sound is of another medium and trigger than the probe's preset states, and its peak is off the point."""
    medium = structs.replace(BPL, sound_speed_m_s=speed, trigger_offset_s=trigger_offset_s)
    arrival_s = 0.04 / speed + trigger_offset_s
    samples = counts(point(4e-3, 0.04, preset=medium))
    assert coherence(samples, lateral_m=4.8e-3, depth_m=BPL.sound_speed_m_s * arrival_s) > 0.97


def test_two_points_share_the_energy():
    """Far enough apart along the array to be resolved, either one holds half of the energy."""
    samples = counts(point(3e-3, 0.04) + point(5e-3, 0.04))
    assert coherence(samples, lateral_m=3e-3) == pytest.approx(0.5, abs=0.06)
    assert coherence(samples, lateral_m=5e-3) == pytest.approx(0.5, abs=0.06)


def test_noise_is_left_out():
    rng = np.random.default_rng(3)
    noise = rng.normal(0, WHITE, point(4e-3, 0.04).shape)
    sigma = float(np.std(signals_of(counts(noise))[400:1600, PAD : PAD + 128]))
    assert coherence(counts(point(4e-3, 0.04, share=40.0) + noise), sigma=sigma) == pytest.approx(1.0, abs=0.03)


def test_a_weak_peak_has_none():
    """Noise would decide it."""
    assert coherence(counts(point(4e-3, 0.04)), intensity=30.0, sigma=3.0) is None


def test_channels_with_random_signs_are_not_in_phase():
    signs = np.random.default_rng(8).choice([-1.0, 1.0], (128, 1))
    assert coherence(counts(signs * point(4e-3, 0.04))) < 0.2


def test_energies_are_those_of_aligned_channels():
    """Against channels that are aligned with NumPy, wave by wave."""
    rng = np.random.default_rng(11)
    signals = signals_of(counts(point(4e-3, 0.04) + rng.normal(0, 50, (128, 2080))))
    element_m = BPL.array.lateral_m
    place_m = rng.uniform(-0.02, 0.02, 12)
    per_metre = rng.uniform(24e3, 28e3, 12)
    of_sum = np.empty(12)
    of_channels = np.empty(12)
    used = np.empty(12, np.int64)
    arrival = (1039.4, 0.3)
    aligned_energies(signals, element_m, place_m, per_metre, arrival, 40, 0.012, of_sum, of_channels, used)
    for wave in range(12):
        near = np.flatnonzero(np.abs(element_m - place_m[wave]) <= 0.012)
        path_m = np.hypot(arrival[0] / per_metre[wave], element_m[near] - place_m[wave])
        times = path_m[:, None] * per_metre[wave] + arrival[1] + np.arange(-40, 41, 2)
        aligned = [
            np.interp(row, np.arange(len(signals)), signals[:, PAD + e]) for e, row in zip(near, times, strict=True)
        ]
        assert of_sum[wave] == pytest.approx(np.sum(np.sum(aligned, axis=0) ** 2) / len(near), rel=1e-4)
        assert of_channels[wave] == pytest.approx(np.sum(np.square(aligned)), rel=1e-4)
        assert used[wave] == len(near)
