"""Calibrates geometry, timing, sound speed and noise of a rig from a scan of one point source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.calibration import (
    RECEIVED_RATIO,
    Fitted,
    Geometry,
    SourceWaves,
    apex_s,
    fit_geometry,
    fit_moveout,
    require_delays,
    require_peak,
)
from markerseek.core import ChannelFrame, Interval, RecordError, Sample, SearchError
from markerseek.guard import Admission
from markerseek.search.posterior import energy_spread
from markerseek.signals import ProbePreset, common_wave

NEAR_SHARE = 0.4
"""Frames above this share of the largest intensity are near enough to the image plane to fit the sound speed."""

STRAIGHT_SHARE = 0.2
"""Channels within this share of the depth to either side of the source count as straight above it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Geometry and noise of a rig."""

    geometry: Geometry
    """Its ``source_deg`` is the readback with the source in the image plane."""
    noise_sigma: Fitted
    """Standard deviation of the beamformed noise in counts, with that of its mean over the frames."""
    energy_spread: float | None
    """Relative standard deviation of an acquisition's energy; None if the scan does not show it."""
    frames: int
    waves: int
    """``frames`` and ``waves``: number of frames, and of those whose wave was clear enough to be used."""


def calibrate(samples: Sequence[Sample], preset: ProbePreset) -> Calibration:
    """Return the calibration from one scan of a point source.

    ``samples``: one for each angle, in the order of the angles, with their frames of channel data. ``preset``: the
    assumed probe; sound speed and trigger offset need only be rough. Raises `SearchError` if the scan does not show a
    single point source that is strong enough; the message says what to change.
    """
    frames = [sample.frame for sample in samples if isinstance(sample.frame, ChannelFrame)]
    if len(frames) < len(samples) or not frames:
        raise RecordError("calibration needs the channel data of a scan, and this one holds none at some angles")
    # Clipped samples shift the peak of the wave, and so every time that is fitted.
    require_peak(samples, saturated_limit=Admission().saturated_limit)
    readings = [sample.reading for sample in samples]
    strongest = max(readings, key=lambda reading: reading.intensity)
    if strongest.lateral_m is None or strongest.depth_m is None:
        raise RecordError("calibration needs frames that are imaged, and these were not")
    noise = np.array([0.0 if reading.noise_sigma is None else reading.noise_sigma for reading in readings])
    element_m = preset.array.lateral_m
    place = {"lateral_m": strongest.lateral_m, "depth_m": strongest.depth_m}
    near = [
        wave.arrival_s
        for reading, frame in zip(readings, frames, strict=True)
        if reading.intensity >= NEAR_SHARE * strongest.intensity
        and (wave := common_wave(frame, preset, **place)) is not None
    ]
    # t(y) = t0 + sqrt((y - y0)² + r²)/c: near the image plane c and r are the same in all frames.
    moveout = fit_moveout(near, element_m)
    # Off the plane an oblique wave is smeared less than one from straight below, so that few channels are alike.
    straight_m = STRAIGHT_SHARE * strongest.depth_m
    received = [
        (sample.angle_deg, wave)
        for sample, frame, sigma in zip(samples, frames, noise, strict=True)
        if sample.reading.intensity > RECEIVED_RATIO * sigma
        and (wave := common_wave(frame, preset, within_m=straight_m, **place)) is not None
    ]
    if not received:
        raise SearchError("the source's wave is too weak at every angle; average more pulses")
    # All waves are aligned with the strongest one, whose arrival time is the most certain.
    strongest_wave = max((wave for _, wave in received), key=lambda wave: float(np.abs(wave.wave).max()))
    plane_s = apex_s(strongest_wave.arrival_s, element_m, moveout)
    waves = SourceWaves(
        angle_deg=np.array([angle_deg for angle_deg, _ in received]),
        arrival_s=np.array([apex_s(wave.arrival_s, element_m, moveout, plane_s=plane_s) for _, wave in received]),
        wave=np.array([wave.wave for _, wave in received]),
        sigma=np.array([wave.sigma for _, wave in received]),
        sampling_hz=preset.sampling_hz,
    )
    geometry = fit_geometry(waves, moveout)
    angles_deg = [sample.angle_deg for sample in samples]
    require_delays(waves, geometry)
    return Calibration(
        geometry=geometry,
        noise_sigma=Fitted(value=float(noise.mean()), sigma=float(noise.std(ddof=1) / np.sqrt(len(noise)))),
        energy_spread=energy_spread(samples, limits=Interval(low_deg=min(angles_deg), high_deg=max(angles_deg))),
        frames=len(frames),
        waves=len(received),
    )
