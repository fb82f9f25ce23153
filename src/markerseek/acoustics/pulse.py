"""Table of a source's pulse at a point of an element, by attenuating path and by fraction of a sample.

The spectra of source, laser and band are multiplied, by the attenuation over each of several path lengths too, and the
inverse transform is arranged by phase: one line for each fraction of a sample, so that a pulse at any moment is an
interpolation of two neighbouring lines and is added to the channel without a lookup for each sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.fft

from markerseek.acoustics.medium import Medium
from markerseek.acoustics.receiver import Band
from markerseek.acoustics.source import GaussianAbsorber, LaserPulse
from markerseek.core import Complex128, ConfigError, Float32

REFERENCE_RANGE_M = 50e-3
"""Distance at which an absorber of strength 1 peaks at 1, in a lossless medium, on a point of an element."""

PHASES = 32
"""Lines per sample; the mix of two is within 3e-4 of the pulse at 9 MHz sampled with 40 MHz."""

_WINDOW = 2048  # samples in which the pulse must lie: sets the fineness of the spectrum
_TAIL = 3e-4  # the pulse ends where it has fallen to this part of its peak
_STEP_NP = 0.15  # attenuation at the pulse's upper end over one step of path; a mix of two is off by 0.15²/8
_MAX_RANGES = 512


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PulseTable:
    """Pulse of one source at a point of an element."""

    lines: Float32[np.ndarray, "ranges phases length"]
    """Pulse g by path length, phase and sample: ``lines[k, p, j]`` is g at (first + j − p / PHASES) samples after the
    arrival, attenuated over the path k·step_m; without the spreading 1/r. Its envelope peaks at 1 for k = 0. Paths
    between are mixed from two tables."""
    first: int
    """Sample, counted from the arrival, at which the lines begin; negative."""
    step_m: float
    """Path length between one table and the next; infinite for one table."""
    loss_np_m: float
    """Attenuation at the middle frequency of the pulse, in Np/m."""
    top_hz: float
    """Frequency above which there is nothing left of the pulse (−60 dB)."""


@lru_cache(maxsize=64)
def pulse_table(
    source: GaussianAbsorber, *, laser: LaserPulse, band: Band, medium: Medium, sampling_hz: float, longest_m: float
) -> PulseTable:
    """Return the table of the pulse of a source, made once for each set of arguments.

    ``source``: it, like the other arguments, must be hashable. ``medium``: speed of sound and attenuation.
    ``longest_m``: longest path that is needed. Raises `ConfigError` if the band reaches beyond half of the sampling
    frequency, if nothing of the sound lies in the band, or if the pulse is too long.
    """
    frequency_hz = scipy.fft.rfftfreq(_WINDOW, 1 / sampling_hz)
    if band.gain(frequency_hz[-1:])[0] > 1e-3:
        raise ConfigError(
            f"sampling_hz is {sampling_hz} Hz, half of which is inside the band up to {band.high_hz} Hz; "
            "sample faster or narrow the band"
        )
    product = source.spectrum(frequency_hz, sound_speed_m_s=medium.sound_speed_m_s)
    product = product * laser.spectrum(frequency_hz) * band.gain(frequency_hz)
    magnitude = np.abs(product)
    # the closed forms are exact down to very small numbers; below this they are no sound but an underflow
    if not 1e-200 < magnitude.max() < math.inf:
        raise ConfigError(
            f"{source} under {laser} leaves nothing in the band {band}; take a smaller absorber or a shorter pulse"
        )
    # Scaled to 1 before the transform: the spectrum itself may be as small as 1e-200.
    product = product / _envelope_peak(product / magnitude.max()) / magnitude.max()
    # The step of the paths is set by the attenuation over it, at the upper end of the pulse's band.
    attenuation = medium.attenuation_np_m(frequency_hz)
    strongest = float(attenuation[magnitude > 0.05 * magnitude.max()].max())
    step_m = max(_STEP_NP / strongest, longest_m / _MAX_RANGES) if strongest > 0 else math.inf
    path_m = np.arange(math.ceil(longest_m / step_m) + 1) * step_m if strongest > 0 else np.zeros(1)
    spectra = product * np.exp(-path_m[:, np.newaxis] * attenuation)
    first, lines = _by_phase(spectra, source)
    return PulseTable(
        lines=lines,
        first=first,
        step_m=step_m,
        loss_np_m=float(magnitude**2 @ attenuation / (magnitude**2).sum()),
        top_hz=float(frequency_hz[magnitude > 1e-3 * magnitude.max()][-1]),
    )


def _envelope_peak(spectrum: Complex128[np.ndarray, " frequencies"]) -> float:
    """Return the peak of the envelope of the pulse with this spectrum, up to half the sampling frequency."""
    # Eight times oversampled: between two samples the envelope may be higher than at them.
    analytic = scipy.fft.ifft(2 * spectrum, _WINDOW * 8, norm="forward")
    return float(np.abs(analytic).max())


def _by_phase(
    spectra: Complex128[np.ndarray, "ranges frequencies"], source: GaussianAbsorber
) -> tuple[int, Float32[np.ndarray, "ranges phases length"]]:
    """Return the pulses laid out by phase, and the sample after the arrival at which they begin."""
    ranges = spectra.shape[0]
    fine = _WINDOW * PHASES
    half = fine // 2
    pulses = np.empty((ranges, fine), dtype=np.float32)
    for row, spectrum in zip(pulses, spectra, strict=True):
        # the arrival in the middle, so that nothing wraps around
        row[:] = np.roll(scipy.fft.irfft(spectrum, fine, norm="forward"), half)
    peaks = np.abs(pulses).max(axis=1, keepdims=True)
    kept = np.flatnonzero((np.abs(pulses) > _TAIL * peaks).any(axis=0))
    first = (kept[0] - half) // PHASES
    last = -((half - kept[-1]) // PHASES) + 2
    if last - first > _WINDOW // 2:
        raise ConfigError(
            f"the pulse of {source} lasts {last - first} samples, at most {_WINDOW // 2} are possible; "
            "shorten the laser pulse or shrink the absorber"
        )
    # whole vector registers, of which a compiled loop takes four at a time
    sample = first + np.arange(-((first - last) // 32) * 32)
    index = half + sample[np.newaxis, :] * PHASES - np.arange(PHASES + 1)[:, np.newaxis]
    return int(first), np.ascontiguousarray(pulses[:, index])
