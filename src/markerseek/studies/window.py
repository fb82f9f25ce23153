"""Time window in which the signal of a marker can arrive, and the imaging chain for frames cut to it.

It is computed once for a drawn rig and marker, and shared by all searches of a trial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel
from markerseek.core import NO_HEADER, ChannelFrame, ConfigError, Float32, Interval, LocalMaxima
from markerseek.rigs import image_reader
from markerseek.signals import ImageReader
from markerseek.studies.unknowns import Unknowns

PEAK_COUNTS = 20_000.0
"""Largest count that the marker alone gives a channel with the probe on it, of the 32,767 that a frame holds."""

_BEFORE_S, _AFTER_S = 4e-6, 6e-6
"""Kept before the earliest and after the latest arrival at the middle of the aperture, in seconds: the edge waves of
an element, the pulse, what the reader gathers about a peak, and (after) the way to the aperture's edge."""

_MARGIN_SAMPLES = 80
"""Samples that the filter fades in or out at each end of the cut."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """What of a rig and its marker is the same for every search; made once."""

    model: AcousticModel
    """The acoustic model of the rig."""
    marker: Absorber
    """The marker, scaled to `PEAK_COUNTS`."""
    first: int
    last: int
    """``first`` and ``last``: samples of the record that are kept: the first, and the one behind the last."""
    reader: ImageReader
    peak: float
    """Intensity of the marker without noise, with the probe on it, in counts."""
    cells: int
    """Independent cells of a whole image."""
    share: float
    """Share of the image's depths that is in the window."""
    blocks: LocalMaxima
    """Local maxima of a whole image without noise, whose blocks those of the window are a part of."""


# The policies of a trial follow one another in one process: few windows are in use at a time.
@lru_cache(maxsize=4)
def window_of(unknowns: Unknowns, travel: Interval) -> Window:
    """Prepare a rig and its marker, which is the same for all policies of a trial.

    ``travel``: angles that the probe can have.
    """
    model, marker = unknowns.model, unknowns.marker
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    preset = imaging.preset
    on_marker = model.channel_data([marker], angle_deg=marker.angle_deg)
    strongest = float(np.abs(on_marker).max())
    if not strongest > 0:
        raise ConfigError(
            f"marker: at radius_m {marker.radius_m} m its signal arrives after the {model.samples} samples of a frame"
        )
    marker = replace(marker, strength=marker.strength * PEAK_COUNTS / strongest)
    frame = frame_of(on_marker * (PEAK_COUNTS / strongest), sampling_hz=preset.sampling_hz)
    reading = imaging.read(frame)
    blocks = reading.local_maxima
    if blocks is None:
        raise ConfigError("the imaging chain gives no local maxima of its image")
    farthest_deg = max(abs(travel.low_deg - marker.angle_deg), abs(travel.high_deg - marker.angle_deg))
    # The path grows with the angle off the marker: the first arrival is at 0, the last at the farthest angle.
    # Beyond 90° the marker is behind the face and gives no signal.
    arrivals = [_arrival_s(unknowns, off_deg) for off_deg in (0.0, min(farthest_deg, 90.0))]
    rate = preset.sampling_hz
    metres = preset.sound_speed_m_s
    low_s, high_s = min(arrivals) - _BEFORE_S, max(arrivals) + _AFTER_S
    # The window begins with a block of the whole image, so that its blocks are some of the image's.
    nearest_m = blocks.first_depth_m - (blocks.depth_step_m - preset.depth_step_m) / 2
    low_m = nearest_m + max(0, math.floor((low_s * metres - nearest_m) / blocks.depth_step_m)) * blocks.depth_step_m
    first = max(0, math.floor(low_m / metres * rate) - _MARGIN_SAMPLES)
    last = min(model.samples, math.ceil(1.04 * high_s * rate) + _MARGIN_SAMPLES)
    # The reader's least depth excludes the laser's pick-up, and the counts of a cut use all 16 bits.
    cut = replace(preset, pickup_samples=0, trigger_offset_s=preset.trigger_offset_s - first / rate, full_scale=32767)
    whole_m = (model.samples - preset.pickup_samples) / rate * metres
    high_m = min(high_s, (last - 1) / rate) * metres
    return Window(
        model=model,
        marker=marker,
        first=first,
        last=last,
        reader=ImageReader(cut, min_depth_m=low_m, max_depth_m=high_m),
        peak=reading.intensity,
        cells=reading.cells or 1,
        share=min(1.0, (high_m - low_m) / whole_m),
        blocks=blocks,
    )


def noise_free(window: Window, *, off_deg: float) -> float:
    """Intensity of the marker without noise, over that with the probe on it.

    ``off_deg``: angle of the probe less that of the marker.
    """
    channels = window.model.channel_data([window.marker], angle_deg=window.marker.angle_deg + off_deg)
    reading = window.reader.read(
        frame_of(channels[:, window.first : window.last], sampling_hz=window.model.sampling_hz)
    )
    return reading.intensity / window.peak


def frame_of(counts: Float32[np.ndarray, "channels samples"], *, sampling_hz: float) -> ChannelFrame:
    """Frame of these counts, rounded, and held where 16 bits end."""
    # Clipped like a converter: an overflow of int16 would change the sign.
    held = np.clip(np.rint(counts), -32767, 32767).astype(np.int16)
    return ChannelFrame(header=NO_HEADER, samples=held, sampling_hz=sampling_hz)


def _arrival_s(unknowns: Unknowns, off_deg: float) -> float:
    """When sound of the marker reaches the middle of the face, in seconds after the trigger."""
    model = unknowns.model
    elevation_m, axial_m = model.probe.in_probe_frame(radius_m=unknowns.marker.radius_m, off_plane_deg=off_deg)
    return math.hypot(elevation_m, axial_m) / model.medium.sound_speed_m_s + model.trigger_offset_s
