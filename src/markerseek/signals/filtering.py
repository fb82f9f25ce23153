"""Filters along time: the band-pass on channels, and the envelope of an image along depth; float32.

The band-pass has linear phase, and its delay is taken out. The windowed sinc is written out, because importing SciPy's
filter design takes longer than all frames of a search; the tests compare it with `scipy.signal.firwin`. The envelope is
that of a finite Hilbert transformer: unlike a transform over the whole depth it smears nothing from one end of the
image to the other.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from markerseek.core import ConfigError, Float32, Float64, Int16
from markerseek.signals._kernel import PAD, fir, magnitude
from markerseek.signals.presets import ProbePreset

HALF_LENGTH = 24
"""Taps on each side of the middle one: the band's edges are some 2.7 MHz wide at 40 MHz."""

TAPER_SAMPLES = 32
"""Length of the raised cosine with which the record fades in after the pick-up, and out at its end."""


@lru_cache(maxsize=16)
def band_pass_taps(preset: ProbePreset) -> Float64[np.ndarray, " taps"]:
    """Return the impulse response of the band-pass: a sinc under a Hamming window, gain 1 in the middle of the band."""
    k = np.arange(-HALF_LENGTH, HALF_LENGTH + 1)
    low = 2 * preset.low_hz / preset.sampling_hz
    high = 2 * preset.high_hz / preset.sampling_hz
    # The difference of two low-passes, scaled to gain 1 at the centre of the band.
    taps = (high * np.sinc(high * k) - low * np.sinc(low * k)) * np.hamming(len(k))
    taps = np.asarray(taps / np.sum(taps * np.cos(np.pi * (low + high) / 2 * k)))
    taps.flags.writeable = False
    return taps


def response(preset: ProbePreset, frequency_hz: Float64[np.ndarray, " bins"]) -> Float64[np.ndarray, " bins"]:
    """Return the gain of the band-pass at the given frequencies; no phase, because its delay is taken out."""
    taps = band_pass_taps(preset)
    k = np.arange(1, HALF_LENGTH + 1)
    waves = np.cos(2 * np.pi * frequency_hz[:, None] / preset.sampling_hz * k)
    return np.asarray(taps[HALF_LENGTH] + 2 * waves @ taps[HALF_LENGTH + 1 :])


def padded_columns(channels: int) -> int:
    """Return the columns that the kernels work on: the channels, padded with zero columns to a multiple of 32."""
    return -(-channels // 32) * 32


def band_pass(
    samples: Int16[np.ndarray, "channels samples"], preset: ProbePreset
) -> Float32[np.ndarray, "samples columns"]:
    """Return the filtered channels, transposed and between zero columns, as the beamformer needs them.

    Each channel's mean is subtracted and the record fades in and out: a step at either end is the same in all channels,
    and would be imaged as a distant source.

    ``samples``: ADC counts. Returns filtered signals, shape (samples, columns); channel c is in column
    c + `_kernel.PAD`. The laser's pick-up is blanked.
    """
    (channels, count) = samples.shape
    blanked = preset.pickup_samples
    if not 0 <= blanked <= count - 2 * TAPER_SAMPLES:
        raise ConfigError(
            f"band-pass: {blanked} of {count} samples are to be blanked; at least {2 * TAPER_SAMPLES} must be left"
        )
    mean = samples[:, blanked:].mean(axis=1, dtype=np.float32)
    padded = np.zeros((count + 2 * HALF_LENGTH, padded_columns(channels)), np.float32)
    rows = padded[HALF_LENGTH : HALF_LENGTH + count, :channels]
    np.subtract(samples.T, mean, out=rows)
    rows *= _taper(count, blanked)[:, None]
    # Zero columns on both sides: the beamformer's rows may reach beyond the array without a test.
    filtered = np.zeros((count, padded.shape[1] + 2 * PAD), np.float32)
    fir(padded, band_pass_taps(preset)[HALF_LENGTH:].astype(np.float32), filtered, PAD)
    return filtered


def _taper(count: int, blanked: int) -> Float32[np.ndarray, " samples"]:
    ramp = (0.5 - 0.5 * np.cos(np.pi * (np.arange(TAPER_SAMPLES) + 0.5) / TAPER_SAMPLES)).astype(np.float32)
    taper = np.ones(count, np.float32)
    taper[:blanked] = 0
    taper[blanked : blanked + TAPER_SAMPLES] = ramp
    taper[count - TAPER_SAMPLES :] = ramp[::-1]
    return taper


QUADRATURE_TAPS = 20
"""Taps on one side; with 20 the gain is 1 to within 1 % from 0.05 to 0.95 of half the row frequency."""

ENVELOPE_MARGIN = 2 * QUADRATURE_TAPS
"""Rows above and below a row that its envelope depends on."""


@lru_cache(maxsize=1)
def quadrature_taps() -> Float32[np.ndarray, " taps"]:
    """Return one side of the Hilbert transformer 2/(pi n), n = 1, 3, 5 ..., under a Kaiser window (beta 5)."""
    n = 2 * np.arange(QUADRATURE_TAPS) + 1
    window = np.kaiser(4 * QUADRATURE_TAPS + 1, 5.0)[2 * QUADRATURE_TAPS + n]
    taps = np.asarray(2 / (np.pi * n) * window, np.float32)
    taps.flags.writeable = False
    return taps


def envelope(rf: Float32[np.ndarray, "depth lateral"]) -> Float32[np.ndarray, "depth lateral"]:
    """Return the magnitude of the analytic signal of an image along depth, in its unit.

    What lies outside counts as zero.
    """
    # Not scipy.signal.hilbert, whose transform is periodic in depth: the pick-up would reach the deepest rows.
    padded = np.pad(rf, ((ENVELOPE_MARGIN, ENVELOPE_MARGIN), (0, 0)))
    out = np.empty(rf.shape, np.float32)
    magnitude(padded, quadrature_taps(), out)
    return out
