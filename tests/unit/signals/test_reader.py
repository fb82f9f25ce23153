"""Readings of the image reader for frames with a known source."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import AcquisitionError, ConfigError
from markerseek.signals import PRESET_NAMES, ImageReader, ProbePreset, beamformed_sigma, features, probe_preset
from markerseek.signals._kernel import PAD
from markerseek.signals.beamform import half_aperture_m, image_grid, path_delay
from markerseek.signals.filtering import band_pass
from tests.unit.signals.pulse_frames import frame_of, pulse_frame

BPL = probe_preset("BPL9-5/55")
READER = ImageReader(BPL)


def counts(clean, scale=800.0):
    return np.clip(np.rint(clean * scale), -2048, 2047).astype(np.int16)


@settings(max_examples=25, deadline=None)
@given(lateral_mm=st.floats(-24, 24), depth_mm=st.floats(15, 65), offset_us=st.floats(-0.8, 0.8))
@example(lateral_mm=0.515625, depth_mm=15.0, offset_us=0.625)  # the largest pixel is not the nearest
def test_position_and_arrival_of_a_source(lateral_mm, depth_mm, offset_us):
    preset = ProbePreset(name="t", trigger_offset_s=offset_us * 1e-6)
    clean = pulse_frame(preset, lateral_m=lateral_mm * 1e-3, depth_m=depth_mm * 1e-3)
    reading = ImageReader(preset).read(frame_of(counts(clean)))
    assert reading.lateral_m == pytest.approx(lateral_mm * 1e-3, abs=0.15e-3)
    assert reading.depth_m == pytest.approx(depth_mm * 1e-3, abs=0.05e-3)
    assert reading.arrival_s == pytest.approx(depth_mm * 1e-3 / 1540 + offset_us * 1e-6, abs=0.03e-6)
    assert reading.centroid_s == pytest.approx(reading.arrival_s, abs=0.03e-6)
    assert reading.coherence > 0.8


@pytest.mark.parametrize(("apart_us", "stronger"), [(0.9, 1.0), (1.5, 0.7), (1.5, 1.3)])
def test_centroid_and_spread_of_a_doublet(apart_us, stronger):
    """Two equal pulses add to the variance what two points would, p(1 - p)d^2; whichever is the higher."""
    apart_m = apart_us * 1e-6 * 1540
    first = pulse_frame(BPL, lateral_m=0.0, depth_m=45e-3)
    second = pulse_frame(BPL, lateral_m=0.0, depth_m=45e-3 + apart_m)
    reading = READER.read(frame_of(counts(first + stronger * second, 600.0)))
    single = READER.read(frame_of(counts(first, 600.0)))
    share = stronger**2 / (1 + stronger**2)
    middle_s = 45e-3 / 1540 + share * apart_us * 1e-6
    spread_s = np.sqrt(single.spread_s**2 + share * (1 - share) * (apart_us * 1e-6) ** 2)
    assert reading.centroid_s == pytest.approx(middle_s, abs=0.02e-6)
    assert reading.spread_s == pytest.approx(spread_s, rel=0.03)


@settings(max_examples=20, deadline=None)
@given(shift=st.floats(-0.5, 0.5))
def test_a_source_between_columns_is_as_strong_as_on_one(shift):
    on = READER.read(frame_of(counts(pulse_frame(BPL, lateral_m=0.5 * BPL.array.pitch_m, depth_m=0.05))))
    off = READER.read(frame_of(counts(pulse_frame(BPL, lateral_m=(0.5 + shift) * BPL.array.pitch_m, depth_m=0.05))))
    assert off.intensity == pytest.approx(on.intensity, rel=0.05)


@settings(max_examples=15, deadline=None)
@given(factor=st.integers(2, 12))
def test_intensity_is_linear(factor):
    samples = counts(pulse_frame(BPL, lateral_m=2e-3, depth_m=0.04), 150)
    once = READER.read(frame_of(samples))
    more = READER.read(frame_of((samples * factor).astype(np.int16)))
    assert more.intensity == pytest.approx(factor * once.intensity, rel=1e-4)
    assert more.lateral_m == pytest.approx(once.lateral_m, abs=1e-8)


@pytest.mark.parametrize("columns", [1, 7, 30])
def test_moving_along_the_array_by_whole_pitches_changes_nothing_else(columns):
    pitch = BPL.array.pitch_m
    here = READER.read(frame_of(counts(pulse_frame(BPL, lateral_m=-5.5 * pitch, depth_m=0.045))))
    there = READER.read(frame_of(counts(pulse_frame(BPL, lateral_m=(columns - 5.5) * pitch, depth_m=0.045))))
    assert there.lateral_m - here.lateral_m == pytest.approx(columns * pitch, abs=1e-6)
    assert there.intensity == pytest.approx(here.intensity, rel=2e-3)
    assert there.depth_m == pytest.approx(here.depth_m, abs=1e-6)


@pytest.mark.parametrize("name", PRESET_NAMES)
@pytest.mark.parametrize("snr_db", [20.0, 30.0, 40.0])
def test_intensity_over_noise_is_the_peak_snr(name, snr_db):
    preset = probe_preset(name)
    rng = np.random.default_rng(3)
    reader = ImageReader(preset)
    clean = pulse_frame(preset, lateral_m=1e-3, depth_m=0.045)
    peak = reader.read(frame_of(counts(clean))).intensity / 800
    scale = 10 ** (snr_db / 20) * beamformed_sigma(6.0, preset=preset) / peak
    found = [
        reader.findings(frame_of(np.rint(clean * scale + rng.normal(0, 6, clean.shape)).astype(np.int16)))
        for _ in range(8)
    ]
    # At 20 dB some frames fall below the level; at 30 dB none.
    assert sum(each.found for each in found) >= (6 if snr_db == 20 else 8)
    assert np.mean([each.peak_snr_db(each.strongest) for each in found]) == pytest.approx(snr_db, abs=1.0)
    assert all(abs(each.strongest.lateral_m - 1e-3) < 0.4e-3 for each in found)


def test_two_sources_are_two_arrivals_strongest_first():
    rng = np.random.default_rng(4)
    samples = (
        pulse_frame(BPL, lateral_m=-8e-3, depth_m=0.03) * 300 + pulse_frame(BPL, lateral_m=9e-3, depth_m=0.05) * 700
    )
    frame = frame_of(np.rint(samples + rng.normal(0, 5, samples.shape)).astype(np.int16))
    findings = READER.findings(frame)
    reading = READER.read(frame)
    assert findings.found
    assert reading.arrivals == (findings.strongest, *findings.others)
    strongest, other = reading.arrivals
    assert (strongest.lateral_m, other.lateral_m) == pytest.approx((9e-3, -8e-3), abs=0.2e-3)
    assert other.depth_m == pytest.approx(0.03, abs=0.1e-3)
    assert reading.intensity == strongest.intensity > other.intensity


@pytest.mark.parametrize("name", PRESET_NAMES)
def test_coherent_energy_is_that_of_aligned_channels(name):
    """Against channels that are aligned with NumPy, point by point."""
    preset = probe_preset(name)
    rng = np.random.default_rng(11)
    source = (3e-3, 0.032)
    clean = pulse_frame(preset, lateral_m=source[0], depth_m=source[1])
    signals = band_pass(counts(clean + rng.normal(0, 0.05, clean.shape)), preset)
    lateral = np.append(rng.uniform(-0.02, 0.02, 20), source[0])
    depth = np.append(rng.uniform(0.012, 0.07, 20), source[1])
    energy, used = features.coherent_energies(signals, preset, lateral_m=lateral, depth_m=depth)
    per_metre, origin = path_delay(preset)
    half = features.window_samples(preset) // 2
    for place, (x, z) in enumerate(zip(lateral, depth, strict=True)):
        depths = z + np.arange(-half, half + 1) * preset.sound_speed_m_s / preset.sampling_hz
        offset = preset.array.lateral_m - x
        near = np.abs(offset) <= half_aperture_m(preset, depths, at_least=features.MIN_CHANNELS / 2)[:, None]
        sample = np.hypot(offset, depths[:, None]) * per_metre + origin
        near &= np.floor(sample) < len(signals) - 1
        first = np.minimum(np.floor(sample).astype(int), len(signals) - 2)
        columns = PAD + np.arange(preset.array.elements)
        late = sample - np.floor(sample)
        values = np.where(near, (1 - late) * signals[first, columns] + late * signals[first + 1, columns], 0)
        assert energy[place] == pytest.approx(np.sum(values.sum(axis=1) ** 2) / np.sum(values**2), rel=1e-5)
        assert used[place] == near.sum(axis=1).max()
    assert energy[-1] / used[-1] > 0.9


@pytest.mark.parametrize("name", PRESET_NAMES)
@settings(max_examples=12, deadline=None)
@given(lateral_mm=st.floats(-15, 15), depth_mm=st.floats(15, 60))
@example(lateral_mm=-7.3, depth_mm=16.43)  # the lowest of 300 places
def test_local_maxima_are_as_high_as_the_source_between_columns_too(name, lateral_mm, depth_mm):
    """The reader's intensity, beamformed on columns a quarter of a pitch apart, is the second opinion."""
    preset = probe_preset(name)
    clean = pulse_frame(preset, lateral_m=lateral_mm * 1e-3, depth_m=depth_mm * 1e-3)
    reading = ImageReader(preset).read(frame_of(counts(clean)))
    near = reading.local_maxima.near(
        lateral_m=lateral_mm * 1e-3, low_depth_m=(depth_mm - 0.2) * 1e-3, high_depth_m=(depth_mm + 0.2) * 1e-3
    )
    # Pixels alone are up to 37 % too low.
    assert 0.83 * reading.intensity <= near[0] <= 1.03 * reading.intensity
    beside = 1e-3 * (lateral_mm + (-8 if lateral_mm > 0 else 8))
    far = reading.local_maxima.near(lateral_m=beside, low_depth_m=depth_mm * 1e-3, high_depth_m=depth_mm * 1e-3)
    assert far[0] < 0.2 * reading.intensity


def test_local_maxima_are_those_of_the_picture():
    rng = np.random.default_rng(9)
    samples = pulse_frame(BPL, lateral_m=3e-3, depth_m=0.04) * 300 + rng.normal(0, 5, (128, 2080))
    frame = frame_of(np.rint(samples).astype(np.int16))
    maxima = READER.read(frame).local_maxima
    picture = READER.picture(frame)
    heights = np.frombuffer(maxima.intensities, "<f4").reshape(maxima.rows, maxima.columns)
    rows, columns = (
        round(step / pixel)
        for step, pixel in ((maxima.depth_step_m, BPL.depth_step_m), (maxima.lateral_step_m, BPL.array.pitch_m))
    )
    for i, j in np.ndindex(heights.shape):
        block = picture.envelope[i * rows : (i + 1) * rows, j * columns : (j + 1) * columns]
        # Midway between two columns a peak is up to 4 dB higher than in its pixels.
        assert block.max() <= heights[i, j] <= 1.8 * block.max()
    assert maxima.first_depth_m == pytest.approx(picture.depth_m[:rows].mean())
    assert maxima.first_lateral_m == pytest.approx(picture.lateral_m[:columns].mean())


@pytest.mark.parametrize("name", PRESET_NAMES)
@pytest.mark.parametrize("blocks", [1, 3])
def test_noise_of_a_window_exceeds_a_level_as_often_as_its_cells_say(name, blocks):
    """Noise exceeds levels of 0.5, 0.1 and 0.01 by the law; the law overstates the lower half."""
    preset = probe_preset(name)
    rng = np.random.default_rng(10)
    reader = ImageReader(preset)
    below = []
    for _ in range(24):
        reading = reader.read(frame_of(np.rint(rng.normal(0, 20, (128, 2080))).astype(np.int16)))
        maxima = reading.local_maxima
        side_m = (blocks - 1) / 2
        for row in range(0, maxima.rows - blocks, blocks):
            for column in range(0, maxima.columns - blocks, blocks):
                depth_m = maxima.first_depth_m + (row + side_m) * maxima.depth_step_m
                height, cells = maxima.near(
                    lateral_m=maxima.first_lateral_m + (column + side_m) * maxima.lateral_step_m,
                    low_depth_m=depth_m - side_m * maxima.depth_step_m,
                    high_depth_m=depth_m + side_m * maxima.depth_step_m,
                    within_m=side_m * maxima.lateral_step_m,
                )
                below.append((1 - np.exp(-((height / reading.noise_sigma) ** 2) / 2)) ** cells)
    shares = [np.mean(np.array(below) > level) for level in (0.5, 0.9, 0.99)]
    assert np.all(np.array(shares) < [0.55, 0.125, 0.017])
    assert np.all(np.array(shares) > [0.25, 0.06, 0.006])


def test_a_strong_source_without_its_coherence_is_none():
    rng = np.random.default_rng(5)
    samples = pulse_frame(BPL, lateral_m=0.0, depth_m=0.05) * 700 + rng.normal(0, 5, (128, 2080))
    mixed = samples[rng.permutation(128)] * rng.choice([-1, 1], 128)[:, None]
    findings = READER.findings(frame_of(np.rint(mixed).astype(np.int16)))
    assert not findings.found
    assert "in phase" in findings.reason


def test_the_reason_names_what_noise_reaches():
    frame = frame_of(np.rint(np.random.default_rng(6).normal(0, 5, (128, 2080))).astype(np.int16))
    findings = READER.findings(frame)
    assert not findings.found
    assert findings.others == ()
    assert "noise alone reaches" in findings.reason
    assert READER.read(frame).arrivals == ()


def test_a_silent_frame_is_read_and_holds_nothing():
    frame = frame_of(np.full((128, 2080), 7, np.int16))
    findings = READER.findings(frame)
    assert not findings.found
    assert findings.reason == "the frame is zero"
    assert findings.peak_snr_db(findings.strongest) is None
    assert findings.dead_channels == tuple(range(128))
    assert READER.read(frame).intensity == 0


def test_saturation_is_reported_where_the_marker_is():
    clean = pulse_frame(BPL, lateral_m=0.0, depth_m=0.05)
    noise = np.random.default_rng(7).normal(0, 3, clean.shape)
    assert READER.read(frame_of(counts(clean * 1000 + noise, 1))).saturated_fraction == 0
    clipped = frame_of(counts(clean * 6000 + noise, 1))
    assert READER.read(clipped).saturated_fraction > 0.5
    assert len(READER.findings(clipped).saturated_channels) > 20
    elsewhere = np.rint(clean * 1000 + noise).astype(np.int16)
    elsewhere[:, 300] = -2048
    assert READER.read(frame_of(elsewhere)).saturated_fraction == 0


def test_a_pick_up_at_full_scale_saturates_no_channel():
    """It is blanked, also for a source right behind it."""
    samples = np.zeros((128, 2080), np.int16)
    samples[:, : BPL.pickup_samples] = 2047
    depth_m = (BPL.pickup_samples + 3) * BPL.sound_speed_m_s / BPL.sampling_hz
    assert features.saturated_channels(samples, BPL, lateral_m=0.0, depth_m=depth_m)[0] == ()
    samples[64, BPL.pickup_samples] = 2047
    assert features.saturated_channels(samples, BPL, lateral_m=0.0, depth_m=depth_m)[0] == (64,)


def test_saturation_in_the_most_negative_number_is_seen():
    samples = np.rint(pulse_frame(BPL, lateral_m=0.0, depth_m=0.05) * 1000).astype(np.int16)
    touching = np.where(samples < -500, np.int16(-32768), samples)
    found, used = features.saturated_channels(touching, BPL, lateral_m=0.0, depth_m=0.05)
    assert len(found) > used / 2


def test_default_depths_hide_nothing_but_the_pickup():
    picture = ImageReader(probe_preset("L3-8")).picture(frame_of(np.zeros((128, 2455), np.int16)))
    assert picture.depth_m[0] <= 200 * 1480 / 40e6 + 1e-9
    assert picture.depth_m[-1] > 2400 * 1480 / 40e6
    assert picture.envelope.shape == (len(picture.depth_m), len(picture.lateral_m)) == (len(picture.depth_m), 128)


@pytest.mark.parametrize(
    ("shape", "hz", "words"),
    [((64, 2080), 40e6, "64 channels"), ((128, 2080), 20e6, "2e+07 Hz"), ((128, 150), 40e6, "150 samples")],
)
def test_a_frame_of_another_probe_is_refused(shape, hz, words):
    with pytest.raises(AcquisitionError) as error:
        READER.read(frame_of(np.zeros(shape, np.int16), hz))
    assert words in str(error.value)
    assert "BPL9-5/55" in str(error.value)


def test_a_record_that_ends_before_the_image_begins_is_refused():
    with pytest.raises(ConfigError, match=r"ends at a depth of -1460 mm.*check trigger_offset_s"):
        ImageReader(structs.replace(BPL, trigger_offset_s=1e-3)).read(frame_of(np.zeros((128, 2080), np.int16)))


@pytest.mark.parametrize(
    "field", ["sampling_hz", "sound_speed_m_s", "low_hz", "high_hz", "f_number", "trigger_offset_s"]
)
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_presets_refuse_what_is_no_number(field, value):
    with pytest.raises(ConfigError):
        ProbePreset(name="t", **{field: value})


@pytest.mark.parametrize(
    "arguments",
    [
        {"low_hz": 9e6, "high_hz": 5e6},
        {"high_hz": 19e6},
        {"pickup_samples": -1},
        {"full_scale": 0},
        {"sound_speed_m_s": -1.0},
    ],
)
def test_presets_refuse_what_cannot_be(arguments):
    with pytest.raises(ConfigError):
        ProbePreset(name="t", **arguments)


def test_grids_refuse_what_cannot_be():
    with pytest.raises(ConfigError):
        image_grid(BPL, samples=2080, depth_m=np.array([0.02, 0.01]))
