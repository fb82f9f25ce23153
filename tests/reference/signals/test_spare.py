"""SPARE against delay-and-sum of the same simulated channels, through a machine that is written out in the tests."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from msgspec import structs

from markerseek.acoustics import Absorber, AcousticModel, RectanglePulse
from markerseek.core import AcquisitionError, ChannelFrame, FrameHeader
from markerseek.signals import ImageReader, SpareReader, probe_preset
from markerseek.signals.beamform import beamform_at
from markerseek.signals.filtering import envelope
from tests.unit.signals.pulse_frames import post_beamformed

HEADER = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
PRESET = probe_preset("BPL9-5/55")
LATERAL_M = 0.05e-3 * np.arange(-50, 51)


def channels_of(depth_m, lateral_m, *, trigger_offset_s=0.0):
    # A short pulse: a long one has two edges of nearly equal height, and either may be the peak of an image.
    model = AcousticModel(laser=RectanglePulse(duration_s=50e-9), trigger_offset_s=trigger_offset_s)
    source = Absorber(radius_m=depth_m + model.probe.face_radius_m, angle_deg=0.0, lateral_m=lateral_m)
    data = model.channel_data([source], angle_deg=0.0)
    return 20_000 / np.abs(data).max() * data


def machine(channels, *, line_m=PRESET.array.lateral_m):
    rf = post_beamformed(
        channels,
        element_m=PRESET.array.lateral_m,
        line_m=line_m,
        sampling_hz=PRESET.sampling_hz,
        sound_speed_m_s=PRESET.sound_speed_m_s,
        f_number=PRESET.f_number,
    )
    return rf_frame(32_000 / np.abs(rf).max() * rf)


def rf_frame(rf):
    return ChannelFrame(header=HEADER, samples=np.rint(rf).astype(np.int16), sampling_hz=PRESET.sampling_hz)


def fwhm(position, values):
    """Full width at half maximum about the largest value, between samples."""
    top = int(np.argmax(values))
    half = values[top] / 2
    low = top - int(np.argmax(values[top::-1] < half))
    high = top + int(np.argmax(values[top:] < half))
    left = np.interp(half, values[[low, low + 1]], position[[low, low + 1]])
    right = np.interp(half, values[[high, high - 1]], position[[high, high - 1]])
    return right - left


def width(image_at, reading):
    depth = reading.depth_m + PRESET.depth_step_m * np.arange(-60, 61)
    patch = envelope(image_at(lateral_m=reading.lateral_m + LATERAL_M, depth_m=depth))
    return fwhm(LATERAL_M, patch[60])


@pytest.mark.parametrize("trigger_offset_s", [0.0, 0.5e-6])
@pytest.mark.parametrize(("depth_m", "lateral_m"), [(20e-3, 0.0), (50e-3, -11e-3), (65e-3, 0.2e-3)])
def test_position_and_width_are_those_of_delay_and_sum(depth_m, lateral_m, trigger_offset_s):
    preset = structs.replace(PRESET, trigger_offset_s=trigger_offset_s)
    channels = channels_of(depth_m, lateral_m, trigger_offset_s=trigger_offset_s)
    das = ImageReader(preset)
    held = ChannelFrame(header=HEADER, samples=np.rint(channels).astype(np.int16), sampling_hz=preset.sampling_hz)
    expected = das.read(held)
    spare = SpareReader(preset)
    frame = machine(channels)
    found = spare.findings(frame).strongest
    assert abs(found.lateral_m - expected.lateral_m) <= 0.05e-3
    assert abs(found.depth_m - expected.depth_m) <= 0.05e-3
    assert abs(found.depth_m - depth_m) <= 0.05e-3
    assert found.arrival_s == pytest.approx(found.depth_m / preset.sound_speed_m_s + trigger_offset_s)
    das_width = width(partial(beamform_at, das._chain(held).signals, preset), expected)
    assert width(partial(spare._image_at, spare._image(frame)[0]), found) <= 1.5 * das_width


def test_before_it_the_source_is_smeared_and_at_half_its_depth():
    """What the reconstruction is for: in the machine's own image a point at 50 mm is some 20 mm wide, at 25 mm."""
    rf = machine(channels_of(50e-3, 0.0)).samples.astype(float)
    image = np.abs(envelope(np.ascontiguousarray(rf.T, dtype=np.float32)))
    row, _ = np.unravel_index(np.argmax(image), image.shape)
    assert abs(row / PRESET.sampling_hz * PRESET.sound_speed_m_s / 2 - 25e-3) < 2e-3
    lines = image.max(axis=0)
    assert np.ptp(PRESET.array.lateral_m[lines > lines.max() / 2]) > 8e-3


def test_lines_may_be_denser_than_elements():
    line_m = 0.2e-3 * (np.arange(200) - 99.5)
    preset = structs.replace(PRESET, array=structs.replace(PRESET.array, elements=200, pitch_m=0.2e-3))
    found = SpareReader(preset).findings(machine(channels_of(45e-3, 3e-3), line_m=line_m)).strongest
    assert abs(found.lateral_m - 3e-3) < 0.05e-3
    assert abs(found.depth_m - 45e-3) < 0.05e-3


@pytest.mark.long
def test_noise_alone_is_no_source():
    rng = np.random.default_rng(5)
    for _ in range(3):
        noise = machine(rng.standard_normal((128, 2080)))
        findings = SpareReader(PRESET).findings(noise)
        assert not findings.found
        assert "SPARE, from post-beamformed RF, dynamic receive focus" in findings.reason


def test_the_image_on_any_columns_is_that_of_the_table():
    reader = SpareReader(PRESET)
    frame = machine(channels_of(40e-3, 2e-3))
    signals, _, grid, _ = reader._image(frame)
    from markerseek.signals.beamform import beamform

    table = beamform(signals, grid)
    some = slice(500, 800, 7)
    plain = reader._image_at(signals, lateral_m=grid.lateral_m[20:90:9], depth_m=grid.depth_m[some])
    assert np.abs(plain - table[some, 20:90:9]).max() < 1e-4 * np.abs(table).max()


def test_a_frame_of_zeros_is_called_so():
    findings = SpareReader(PRESET).findings(rf_frame(np.zeros((128, 2080))))
    assert not findings.found
    assert findings.reason == ImageReader(PRESET).findings(zeros()).reason == "the frame is zero"


def zeros():
    return ChannelFrame(header=HEADER, samples=np.zeros((128, 2080), np.int16), sampling_hz=PRESET.sampling_hz)


def test_a_pick_up_at_full_scale_saturates_no_line():
    """It is blanked."""
    rf = np.zeros((128, 2080))
    rf[:, :100] = 32_767
    reader = SpareReader(structs.replace(PRESET, f_number=0.5))
    assert reader._saturated_lines(rf_frame(rf), lateral_m=0.0, depth_m=6e-3) == ()
    rf[60:64] = 32_767
    assert set(reader._saturated_lines(rf_frame(rf), lateral_m=0.0, depth_m=6e-3)) == {60, 61, 62, 63}


def test_what_is_not_of_this_machine_is_refused():
    reader = SpareReader(PRESET)
    samples = np.zeros((128, 2080), np.int16)
    with pytest.raises(AcquisitionError, match="a frame of 64 lines, 128 are expected"):
        reader.findings(ChannelFrame(header=HEADER, samples=samples[:64], sampling_hz=40e6))
    with pytest.raises(AcquisitionError, match="sampled at 2e"):
        reader.findings(ChannelFrame(header=HEADER, samples=samples, sampling_hz=20e6))
    with pytest.raises(AcquisitionError, match="a frame of 200 samples"):
        reader.findings(ChannelFrame(header=HEADER, samples=samples[:, :200], sampling_hz=40e6))
