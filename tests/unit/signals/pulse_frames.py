"""Frames of the sound of one point."""

from __future__ import annotations

import numpy as np

from markerseek.core import ChannelFrame, FrameHeader


def frame_of(samples, hz=40e6):
    header = FrameHeader(sequence=1, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    return ChannelFrame(header=header, samples=samples, sampling_hz=hz)


def pulse_frame(preset, *, lateral_m, depth_m, samples=2080):
    """A Gaussian wave packet of amplitude 1 in the middle of the band, as every element receives it from one point."""
    path = np.hypot(preset.array.lateral_m - lateral_m, depth_m)
    arrival = path / preset.sound_speed_m_s + preset.trigger_offset_s
    time = np.arange(samples) / preset.sampling_hz - arrival[:, None]
    width = 1 / (np.pi * (preset.high_hz - preset.low_hz))
    return np.exp(-((time / width) ** 2) / 2) * np.cos(np.pi * (preset.low_hz + preset.high_hz) * time)
