"""Noise of the image from the noise of a channel, and its number of independent cells, which sets false alarms."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import ConfigError, Float64
from markerseek.signals.beamform import half_aperture_m
from markerseek.signals.filtering import response
from markerseek.signals.presets import ProbePreset

_BINS = 513
"""Frequencies from 0 to half the sampling frequency: those of 1,024 samples."""


def beamformed_sigma(
    channel_sigma: float, *, preset: ProbePreset, power: Float64[np.ndarray, " bins"] | None = None
) -> float:
    """Return the standard deviation of the beamformed signal (one quadrature) that channel noise leads to.

    The noise is independent between channels. The sum over n of them is divided by the root of n, so neither depth
    nor aperture changes it; what remains is the band-pass and the linear interpolation between samples, whose power
    gain averaged over all fractions of a sample is 2/3 + cos(w)/3 at the angular frequency w per sample.

    ``channel_sigma``: standard deviation of one channel's noise, all frequencies together, in ADC counts. ``power``:
    power of that noise on a grid of evenly spaced frequencies from 0 to half the sampling frequency (that of ``rfft``),
    on any scale; None is white. Returns standard deviation in ADC counts.
    """
    if not 0 <= channel_sigma < math.inf:
        raise ConfigError(f"channel_sigma is {channel_sigma} counts, it must be 0 or more and finite")
    spectrum = np.ones(_BINS) if power is None else power
    if len(spectrum) < 2 or not (np.all(spectrum >= 0) and 0 < spectrum.sum() < np.inf):
        raise ConfigError("power must hold at least two values, none negative and not all zero")
    # Both ends of the grid stand for half a step.
    weight = np.array(spectrum, dtype=np.float64)
    weight[[0, -1]] /= 2
    return float(channel_sigma * np.sqrt(np.sum(weight * _power_gain(preset, len(weight))) / np.sum(weight)))


def noise_peaks(preset: ProbePreset, *, depth_m: Float64[np.ndarray, " depth"]) -> float:
    """ρ of a noise image with these rows: it has ρ·(u² − 1)·exp(−u²/2) peaks above u standard deviations on average.

    Noise whose in-phase and quadrature parts change with the standard deviations kx and kz of their gradients (in units
    of their own) has ``A kx kz (u^2 - 1) exp(-u^2/2) / (2 pi)`` peaks above u in the area A (Worsley 1994, two degrees
    of freedom in two dimensions). Along depth, kz is the spread of the wave number in the band. Across it, kx is the
    wave number times the spread of the sine of the angle over the aperture.

    ``preset``: the probe, with its default band and aperture. ``depth_m``: rows of the image, evenly spaced.
    """
    gain = _power_gain(preset, _BINS)
    wave = 2 * np.pi * np.linspace(0, preset.sampling_hz / 2, len(gain)) / preset.sound_speed_m_s
    axial = float(np.sqrt(np.average(wave**2, weights=gain) - np.average(wave, weights=gain) ** 2))
    width = preset.array.elements * preset.array.pitch_m
    tangent = np.minimum(half_aperture_m(preset, depth_m), width / 2) / depth_m
    # Mean square of the sine where the tangent is evenly spread from -a to a.
    lateral = np.sqrt(np.average(wave**2, weights=gain) * (1 - np.arctan(tangent) / tangent))
    step = float(depth_m[-1] - depth_m[0]) / max(1, len(depth_m) - 1)
    return float(np.sum(lateral)) * step * width * axial / (2 * math.pi)


def envelope_cells(preset: ProbePreset, *, depth_m: Float64[np.ndarray, " depth"]) -> int:
    """Return the number of independent envelope cells of a noise image with these rows.

    It is the M for which noise alone exceeds u = sqrt(2 ln(M/p)) with probability p = 1e-3: M = ρ·(u² − 1), see
    `noise_peaks`. M grows with the logarithm of p.

    ``preset``: the probe, with its default band and aperture. ``depth_m``: rows of the image, evenly spaced.
    """
    rate = noise_peaks(preset, depth_m=depth_m)
    # M is wanted where M·exp(−u²/2) = p, and depends on u itself: the fixed point, by iteration.
    square: float = 36.0
    for _ in range(6):
        square = 2 * math.log(max(rate * (square - 1), 2.0) / 1e-3)
    return max(1, math.ceil(rate * (square - 1)))


def cell_pixels(preset: ProbePreset) -> float:
    """Return the pixels of noise per independent cell: the sum of the squared correlations of one with all others.

    Along depth it is one over the equivalent bandwidth of the noise, across it λ/(2 sin a) with the half angle a of the
    aperture (Goodman, Statistical Optics, 1985, 6.1: the equivalent area of the correlation).
    """
    gain = _power_gain(preset, _BINS)
    frequency = np.linspace(0, preset.sampling_hz / 2, len(gain))
    bandwidth = gain.sum() ** 2 / (gain**2).sum() * frequency[1]
    axial_m = preset.sound_speed_m_s / bandwidth
    sine = 1.0 if preset.f_number == 0 else 1 / math.hypot(1.0, 2 * preset.f_number)
    lateral_m = preset.sound_speed_m_s / np.average(frequency, weights=gain) / (2 * sine)
    return float(max(1.0, axial_m / preset.depth_step_m) * max(1.0, lateral_m / preset.array.pitch_m))


def _power_gain(preset: ProbePreset, bins: int) -> Float64[np.ndarray, " bins"]:
    """Return the power gain from a channel to the image at even frequencies up to half the sampling frequency."""
    frequency = np.linspace(0, preset.sampling_hz / 2, bins)
    band = response(preset, frequency)
    return np.asarray(band**2 * (2 + np.cos(2 * np.pi * frequency / preset.sampling_hz)) / 3)
