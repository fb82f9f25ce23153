"""Frames of the sound of one point, and what an ultrasound machine makes of its channels."""

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


def post_beamformed(
    channels: np.ndarray,
    *,
    element_m: np.ndarray,
    line_m: np.ndarray,
    sampling_hz: float,
    sound_speed_m_s: float,
    f_number: float,
) -> np.ndarray:
    """Post-beamformed RF of an ultrasound machine, line by line in plain NumPy; it shares no code with SPARE.

    Lines (lines, samples): the machine believes that it transmitted at sample 0, straight down each line.

    Its focus is dynamic: at time t the line listens to depth zb = c·t/2, and the echo from there reaches an element u
    beside the line at (zb + sqrt(zb² + u²))/c.
    """
    count = channels.shape[1]
    sample = np.arange(count)
    rf = np.zeros((len(line_m), count))
    for line, x in enumerate(line_m):
        for element, position in enumerate(element_m):
            u = position - x
            zb = sound_speed_m_s * (sample / sampling_hz) / 2
            place = (zb + np.sqrt(zb**2 + u**2)) / sound_speed_m_s * sampling_hz
            listens = 2 * f_number * abs(u) <= zb
            heard = np.interp(place, sample, channels[element], right=0.0)
            rf[line] += np.where(listens, heard, 0.0)
    return rf
