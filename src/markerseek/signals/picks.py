"""Arrival of one source's wave at each channel, by correlation with the mean wave: for calibration.

No speed of sound is needed: the delay is tracked from channel to channel, from the source outwards. Intensity and depth
of a whole frame are in `reader`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import ChannelFrame, Float64
from markerseek.signals._kernel import PAD
from markerseek.signals.filtering import band_pass
from markerseek.signals.peaks import parabola_peak
from markerseek.signals.presets import ProbePreset

HALF_WINDOW_S = 1.6e-6
"""Time on each side of the expected arrival that is used, in seconds: a doublet of the table's longest pulse."""

_STEP_SAMPLES = 2.0
"""Most that the delay may differ from the one extrapolated, in samples: less than half a period of the carrier."""

_MOST_LOST = 5
"""Most channels in a row that do not correlate; beyond more the wave is not followed. That of a long pulse is a
doublet, and after a gap the wave half a period away may be taken for it."""

_MIN_CORRELATION = 0.6
"""Correlation coefficient with the common wave below which a channel is not used."""

MIN_CHANNELS = 24
"""Fewest channels with the same wave."""

_FINE = 8
"""Points between two samples in the search for the best delay."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommonWave:
    """The wave that the channels of one frame have in common."""

    arrival_s: Float64[np.ndarray, " channels"]
    """When the middle of the wave reaches each channel, in seconds after the trigger; NaN where the channel does not
    correlate with the wave."""
    wave: Float64[np.ndarray, " window"]
    """The wave in counts, the mean of the channels that have it; its middle sample is the arrival."""
    sigma: float
    """Standard deviation of the noise of that mean, from what the channels do not share, in counts."""
    sampling_hz: float


def common_wave(
    frame: ChannelFrame, preset: ProbePreset, *, lateral_m: float, depth_m: float, within_m: float = math.inf
) -> CommonWave | None:
    """Return the wave of one source and its arrival at each channel; None where fewer than `MIN_CHANNELS` agree.

    ``preset``: of its speed of sound and trigger offset only a rough value is needed. ``lateral_m``, ``depth_m``: where
    the source is imaged with this preset. ``within_m``: channels further than this from the source along the array are
    left out.
    """
    filtered = band_pass(frame.samples, preset)
    signals = filtered[:, PAD : PAD + preset.array.elements].T.astype(np.float64)
    rate = preset.sampling_hz
    offset_m = np.abs(preset.array.lateral_m - lateral_m)
    expected = np.hypot(offset_m, depth_m) / preset.sound_speed_m_s * rate + preset.trigger_offset_s * rate
    half = math.ceil(HALF_WINDOW_S * rate)
    wave = np.mean([_window(signals[channel], expected[channel], half) for channel in np.argsort(offset_m)[:8]], axis=0)
    lags = np.zeros(len(expected))
    used = np.zeros(len(expected), dtype=np.bool_)
    aligned = wave[None]
    # The first wave is a rough mean of eight channels; the second pass correlates with the mean of all.
    for _ in range(2):
        lags, correlation = _follow(signals, expected, wave, int(np.argmin(offset_m)))
        # A wave that the record cuts off is not that of the others.
        whole = (expected + lags >= half) & (expected + lags + half < signals.shape[1])
        used = (correlation >= _MIN_CORRELATION) & (offset_m <= within_m) & whole
        if int(used.sum()) < MIN_CHANNELS:
            return None
        aligned = np.array([_window(signals[c], expected[c] + lags[c], half) for c in np.flatnonzero(used)])
        wave = aligned.mean(axis=0)
    return CommonWave(
        arrival_s=np.where(used, (expected + lags) / rate, np.nan),
        wave=wave,
        sigma=float(aligned.std(axis=0).mean() / math.sqrt(len(aligned))),
        sampling_hz=rate,
    )


def _follow(
    signals: Float64[np.ndarray, "channels samples"],
    expected: Float64[np.ndarray, " channels"],
    wave: Float64[np.ndarray, " window"],
    middle: int,
) -> tuple[Float64[np.ndarray, " channels"], Float64[np.ndarray, " channels"]]:
    """Return the extra delay of each channel in samples, and its correlation with the common wave."""
    lags = np.zeros(len(expected))
    correlation = np.zeros(len(expected))
    for outward in (range(middle, len(expected)), range(middle - 1, -1, -1)):
        before: list[float] = []
        lost = 0
        for channel in outward:
            # The median of five channels passes over one bad channel; their slope continues the wave front.
            guess = float(np.median(before[-5:])) if before else (lags[middle] if channel != middle else 0.0)
            if len(before) >= 5:
                guess += 3 * (before[-1] - before[-5]) / 4
            lag, alike = _best_lag(signals[channel], expected[channel] + guess, wave)
            lags[channel] = guess + lag
            correlation[channel] = alike
            lost = 0 if alike >= _MIN_CORRELATION else lost + 1
            if alike >= _MIN_CORRELATION:
                before.append(lags[channel])
            if lost > _MOST_LOST:
                break
    return lags, correlation


def _best_lag(
    signal: Float64[np.ndarray, " samples"], centre: float, wave: Float64[np.ndarray, " window"]
) -> tuple[float, float]:
    """Return the shift of a wave that fits a channel best, in samples, and the coefficient of correlation there."""
    half = len(wave) // 2
    margin = math.ceil(_STEP_SAMPLES) + 1
    section = _window(signal, centre, half + margin)
    # Direct sums: of few lags they take a tenth of the time of Fourier transforms.
    products = np.correlate(section, wave, mode="valid")
    energy = np.correlate(section**2, np.ones(len(wave)), mode="valid")
    shifts = np.arange(-margin, margin + 1)
    fine = np.linspace(-_STEP_SAMPLES, _STEP_SAMPLES, int(2 * _STEP_SAMPLES * _FINE) + 1)
    scale = np.sqrt(np.maximum(energy, 1e-30) * float(wave @ wave))
    smooth = _cubic_at(products, fine + margin)
    best = int(np.argmax(smooth))
    if best in (0, len(fine) - 1):
        return 0.0, 0.0
    left, top, right = smooth[best - 1 : best + 2].tolist()
    lag = float(fine[best]) + parabola_peak(left, top, right)[0] / _FINE
    return lag, float(top / np.interp(lag, shifts, scale))


def _window(signal: Float64[np.ndarray, " samples"], centre: float, half: int) -> Float64[np.ndarray, " window"]:
    """Return the section of a channel about a place between two samples, zero outside the record."""
    start = math.floor(centre)
    around = 12
    places = start + np.arange(-half - around, half + around + 1)
    inside = (places >= 0) & (places < len(signal))
    section = np.where(inside, signal[np.clip(places, 0, len(signal) - 1)], 0.0)
    taps = np.arange(-around, around + 1)
    kernel = np.sinc(taps + (centre - start)) * np.hanning(2 * around + 3)[1:-1]
    return np.convolve(section, kernel, mode="valid")


def _cubic_at(values: Float64[np.ndarray, " n"], places: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
    """Return the values between equally spaced ones, by a cubic through the four nearest."""
    base = np.clip(np.floor(places).astype(np.int64), 1, len(values) - 3)
    t = places - base
    before, at, after, beyond = (values[base + k] for k in (-1, 0, 1, 2))
    return np.asarray(
        at
        + 0.5
        * t
        * (after - before + t * (2 * before - 5 * at + 4 * after - beyond + t * (3 * (at - after) + beyond - before)))
    )
