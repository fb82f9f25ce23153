"""Scales a light spot to the counts of the receiver, with the noise that gives the peak SNR of the settings."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Band, Digitiser, Noise
from markerseek.core import ChannelFrame, ConfigError, Float32, FrameHeader, LinearArray
from markerseek.signals import PRESET_NAMES, ImageReader, beamformed_sigma, probe_preset
from markerseek.sim import SimulatedSettings

MOST_COUNTS = 25_000
"""Amplitude to which a noise-free frame is scaled, in counts, so that rounding to int16 has no effect on its image."""

NO_HEADER = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)

_USUAL_COUNTS = 600.0
"""Largest count of the marker in a channel, where the receiver chooses its own gain and nothing speaks against it."""

_LEAST_SIGMA = 2.0
"""Noise in counts to which that gain is raised where there is room: rounding (variance 1/12) then adds 1 % to it."""

_NOISE_SIGMAS, _JITTER_SIGMAS = 6.0, 5.0
"""Room for the noise's largest sample in some hundred thousand, and for the strongest flash, in standard deviations."""

_OFF_PLANE = 1.5
"""Room for a marker near the array, which is up to 1.34 times as strong in a channel off its plane as in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledSpot:
    """A spot in counts, and the noise beside it; `noise`, `peak` and `peak_counts` are those of `Scene`."""

    absorbers: tuple[Absorber, ...]
    noise: Noise
    peak: float
    peak_counts: float


@lru_cache(maxsize=8)
def image_reader(array: LinearArray, *, sampling_hz: float) -> ImageReader:
    """Imaging chain of a simulated probe; cached, because its tables are expensive to compute.

    Array and sampling are those of the rig, which a user knows; sound speed, band and aperture are those of the first
    preset even if the tissue differs, because a user would not know.
    """
    return ImageReader(replace(probe_preset(PRESET_NAMES[0]), array=array, sampling_hz=sampling_hz))


def image_peak(absorbers: list[Absorber], model: AcousticModel, *, angle_deg: float) -> float:
    """Noise-free envelope peak of absorbers in the image at an angle of the probe, in the unit of their channel data.

    Parameters
    ----------
    absorbers
        The sources.
    model
        Acoustic model.
    angle_deg
        Angle of the probe in degrees.

    Raises
    ------
    ConfigError
        If no signal of them reaches the receiver.
    """
    received = model.channel_data(absorbers, angle_deg=angle_deg)
    largest = _largest(received, absorbers[0], model)
    counts = np.rint(received * (MOST_COUNTS / largest)).astype(np.int16)
    frame = ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=model.sampling_hz)
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    return imaging.read(frame).intensity * largest / MOST_COUNTS


def scaled_spot(
    spot: list[Absorber], marker: Absorber, settings: SimulatedSettings, model: AcousticModel
) -> ScaledSpot:
    """The spot in counts, with noise for the peak SNR of the settings.

    The peak SNR is that of the image: the noise-free envelope peak with the probe on the marker, over the standard
    deviation of the beamformed noise (`markerseek.signals.beamformed_sigma`).

    Parameters
    ----------
    spot
        Absorbers of the marker.
    marker
        Its place.
    settings
        The simulated rig; laser, receiver and noise are used.
    model
        Acoustic model.

    Raises
    ------
    ConfigError
        If no signal of it reaches the receiver.
    """
    largest = largest_count(spot, model, marker)
    peak_over_largest = image_peak(spot, model, angle_deg=marker.angle_deg) / largest
    imaging = image_reader(model.probe.array, sampling_hz=model.sampling_hz)
    # Coloured noise has the spectrum of the receive band; 513 bins resolve it for the beamformer's gain.
    power = Band().gain(np.linspace(0, model.sampling_hz / 2, 513)) ** 2
    share = settings.noise.coloured
    white, coloured = np.sqrt(1 - share), np.sqrt(share)
    gain = math.hypot(
        beamformed_sigma(white, preset=imaging.preset),
        beamformed_sigma(coloured, preset=imaging.preset, power=power),
    )
    # SNR in dB of amplitudes: 20 log10(peak / sigma); sigma after beamforming is gain times that of a channel.
    sigma_over_largest = peak_over_largest / 10 ** (settings.noise.peak_snr_db / 20) / gain
    peak_counts = settings.receiver.peak_counts
    if peak_counts is None:
        peak_counts = _own_gain(settings, sigma_over_largest)
    sigma = peak_counts * sigma_over_largest
    return ScaledSpot(
        absorbers=tuple(replace(each, strength=each.strength * (peak_counts / largest)) for each in spot),
        noise=Noise(white_sigma=sigma * white, coloured_sigma=sigma * coloured, bursts=settings.noise.bursts),
        peak=peak_counts * peak_over_largest,
        peak_counts=peak_counts,
    )


def _own_gain(settings: SimulatedSettings, sigma_over_largest: float) -> float:
    """Largest count of the marker for which marker and noise together stay below full scale.

    Usually `_USUAL_COUNTS`; less where the noise is strong, more where it would drown in the rounding.
    """
    flash = 1 + _JITTER_SIGMAS * settings.laser.energy_jitter / math.sqrt(settings.laser.pulses)
    # One count below full scale, at which the guard takes a channel for saturated.
    markers = 2 if settings.second.present else 1
    most = (Digitiser().largest - 1) / (markers * _OFF_PLANE * flash + _NOISE_SIGMAS * sigma_over_largest)
    return min(max(_USUAL_COUNTS, _LEAST_SIGMA / sigma_over_largest), most)


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
