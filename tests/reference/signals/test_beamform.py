"""The imaging chain against SciPy, PyMUST, and the sums written out in double precision."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from markerseek.signals import PRESET_NAMES, ProbePreset, probe_preset
from markerseek.signals._kernel import PAD
from markerseek.signals.beamform import beamform, beamform_at, image_grid
from markerseek.signals.filtering import HALF_LENGTH, band_pass, band_pass_taps, envelope, response
from markerseek.signals.presets import LinearArray

SAMPLES = 1200


def signals_of(rng, preset, samples=SAMPLES):
    """Random channels as the beamformer takes them, and as a plain array (samples, elements)."""
    plain = rng.standard_normal((samples, preset.array.elements))
    columns = -(-preset.array.elements // 32) * 32
    wide = np.zeros((samples, columns + 2 * PAD), np.float32)
    wide[:, PAD : PAD + preset.array.elements] = plain
    return wide, wide[:, PAD : PAD + preset.array.elements].astype(np.float64)


def plain_sum(plain, preset, lateral_m, depth_m, *, normalised=True):
    """One-way delay-and-sum as it is defined, without any table."""
    total = np.zeros((len(depth_m), len(lateral_m)))
    used = np.zeros_like(total)
    for element, x in enumerate(preset.array.lateral_m):
        offset = np.abs(lateral_m - x)[None, :]
        place = np.hypot(offset, depth_m[:, None]) / preset.sound_speed_m_s + preset.trigger_offset_s
        value = np.interp(place * preset.sampling_hz, np.arange(len(plain)), plain[:, element])
        here = (place * preset.sampling_hz < len(plain) - 1) & (place >= 0)
        if preset.f_number:
            widest = np.maximum(depth_m / (2 * preset.f_number), preset.array.pitch_m / 2)
            here &= offset <= (widest * (1 + 1e-9))[:, None]
        total += np.where(here, value, 0)
        used += here
    return total / np.sqrt(np.maximum(used, 1)) if normalised else total


@pytest.mark.parametrize("f_number", [0.0, 0.8, 2.0])
@pytest.mark.parametrize("elements", [128, 64, 37])
def test_the_image_is_the_sum_written_out(f_number, elements):
    preset = ProbePreset(
        name="t", array=LinearArray(elements=elements, pitch_m=0.3e-3), f_number=f_number, trigger_offset_s=0.3e-6
    )
    wide, plain = signals_of(np.random.default_rng(1), preset)
    depth = np.linspace(1e-3, 46e-3, 301)
    grid = image_grid(preset, samples=SAMPLES, depth_m=depth)
    expected = plain_sum(plain, preset, grid.lateral_m, depth)
    assert np.abs(beamform(wide, grid) - expected).max() < 1e-5 * np.abs(expected).max()
    some = np.array([-0.0123, 0.0, 0.0041])
    expected = plain_sum(plain, preset, some, depth)
    image = beamform_at(wide, preset, lateral_m=some, depth_m=depth)
    assert np.abs(image - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("f_number", "elements", "pitch_m"),
    [(0.0, 128, 0.3e-3), (1.5, 128, 0.3e-3), (1.5, 64, 0.6e-3), (1.5, 192, 0.21e-3)],
)
def test_agrees_with_pymust(f_number, elements, pitch_m):
    """PyMUST's matrix is two-way: with no transmit path left over (passive) it is one-way."""
    import pymust

    preset = ProbePreset(name="t", array=LinearArray(elements=elements, pitch_m=pitch_m), f_number=f_number)
    wide, plain = signals_of(np.random.default_rng(2), preset)
    depth = np.linspace(3e-3, 30e-3, 80)
    grid = image_grid(preset, samples=SAMPLES, depth_m=depth)
    param = pymust.utils.Param()
    param.fs = 40e6
    param.pitch = pitch_m
    param.c = 1540.0
    param.fc = 7e6
    param.fnumber = f_number
    param.passive = True
    param.radius = np.inf
    param.Nelements = elements
    x, z = np.meshgrid(grid.lateral_m, depth)
    matrix = pymust.dasmtx(np.array(plain.shape), x, z, np.zeros((1, elements)), param)
    theirs = (matrix @ plain.flatten(order="F")).reshape(x.shape, order="F")
    scale = plain_sum(np.ones_like(plain), preset, grid.lateral_m, depth)
    ours = beamform(wide, grid) * scale
    assert np.abs(ours - theirs).max() < 1e-3 * np.abs(theirs).max()


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_band_pass_is_that_of_scipy(name):
    preset = probe_preset(name)
    ours = band_pass_taps(preset)
    theirs = signal.firwin(
        2 * HALF_LENGTH + 1, [preset.low_hz, preset.high_hz], fs=preset.sampling_hz, pass_zero=False, window="hamming"
    )
    np.testing.assert_allclose(ours, theirs, atol=1e-12)
    frequency = np.linspace(0, preset.sampling_hz / 2, 50)
    _, gain = signal.freqz(ours, worN=frequency, fs=preset.sampling_hz)
    shift = np.exp(2j * np.pi * frequency / preset.sampling_hz * HALF_LENGTH)
    np.testing.assert_allclose(response(preset, frequency), (gain * shift).real, atol=1e-12)


def test_filtered_channels_are_those_of_scipy():
    samples = np.random.default_rng(3).integers(-500, 500, (128, 900)).astype(np.int16)
    preset = probe_preset("BPL9-5/55")
    filtered = band_pass(samples, preset)[:, PAD : PAD + 128].T
    without_mean = samples[:, 100:] - samples[:, 100:].mean(axis=1, keepdims=True)
    expected = signal.fftconvolve(without_mean, band_pass_taps(preset)[None], "same")
    # The raised cosines at both ends are ours; one filter length further in nothing is left of them.
    inner = slice(32 + HALF_LENGTH, -32 - HALF_LENGTH)
    np.testing.assert_allclose(filtered[:, 100:][:, inner], expected[:, inner], atol=1e-3)
    assert np.all(filtered[:, : 100 - HALF_LENGTH] == 0)


def test_a_constant_offset_of_the_converter_leaves_nothing():
    samples = np.full((128, 900), -300, np.int16)
    assert np.abs(band_pass(samples, probe_preset("L3-8"))).max() < 1e-3


def test_envelope_is_that_of_scipy():
    """In the band of the default preset, whose rows are sampled at 20 MHz; away from the ends."""
    rng = np.random.default_rng(4)
    taps = signal.firwin(129, [5.2e6, 8.8e6], fs=20e6, pass_zero=False)
    rf = signal.fftconvolve(rng.standard_normal((1000, 16)), taps[:, None], "same", axes=0).astype(np.float32)
    expected = np.abs(signal.hilbert(rf, axis=0))
    ours = envelope(rf)
    assert np.abs(ours - expected)[100:-100].max() < 5e-3 * expected.max()


@pytest.mark.parametrize("cycles", [0.06, 0.2, 0.35, 0.47])
def test_envelope_of_a_wave_is_its_amplitude(cycles):
    rf = (3 * np.cos(2 * np.pi * cycles * np.arange(400) + 0.4))[:, None].astype(np.float32)
    np.testing.assert_allclose(envelope(rf)[60:-60], 3, rtol=0.01)
