"""What a simulated probe receives of sources: the largest count in a channel, and the peak in the image."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel
from markerseek.core import NO_HEADER, ChannelFrame, ConfigError, Float32, LinearArray
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset

MAX_COUNTS = 25_000
"""Amplitude to which a noise-free frame is scaled, in counts, so that rounding to int16 has no effect on its image."""


@lru_cache(maxsize=8)
def image_reader(array: LinearArray, *, sampling_hz: float) -> ImageReader:
    """Imaging chain of a simulated probe; cached, because its tables are expensive to compute.

    Array and sampling are those of the rig, which a user knows; sound speed, band and aperture are those of the first
    preset even if the tissue differs, because a user would not know.
    """
    return ImageReader(replace(probe_preset(PRESET_NAMES[0]), array=array, sampling_hz=sampling_hz))


def image_peak(absorbers: list[Absorber], model: AcousticModel, *, angle_deg: float) -> float:
    """Noise-free envelope peak of absorbers in the image at an angle of the probe.

    In the unit of their channel data.
    """
    received = model.channel_data(absorbers, angle_deg=angle_deg)
    largest = _largest(received, absorbers[0], model)
    counts = np.rint(received * (MAX_COUNTS / largest)).astype(np.int16)
    frame = ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=model.sampling_hz)
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    return imaging.read(frame).intensity * largest / MAX_COUNTS


def largest_count(absorbers: list[Absorber], model: AcousticModel, marker: Absorber) -> float:
    """Largest channel amplitude of the absorbers with the probe on the marker."""
    return _largest(model.channel_data(absorbers, angle_deg=marker.angle_deg), marker, model)


def _largest(received: Float32[np.ndarray, "channels samples"], source: Absorber, model: AcousticModel) -> float:
    largest = float(np.abs(received).max())
    if not largest > 0:
        raise ConfigError(
            f"marker: at radius_m {source.radius_m} m and lateral_m {source.lateral_m} m its signal does not arrive "
            f"within {model.samples} samples; move it nearer or record for longer"
        )
    return largest
