"""Features of an image and its channels: noise floor, coherence, energy in depth, saturation, dead channels.

Two tests decide whether a peak is a source. Its height over the noise floor rules out noise. Its coherence rules out
sound that does not come from a point: with random signs on the channels, the energy of the sum over the energy of the
channels exceeds t with a probability of about exp(-t), whatever the channels hold, if both quadratures are in the
window. Both levels follow from the number of tests and the accepted rate of false alarms.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import Float32, Float64, Int16, Int64
from markerseek.signals import _kernel as kernel
from markerseek.signals._kernel import PAD
from markerseek.signals.beamform import beamform_at, elements_m, half_aperture_m, path_delay
from markerseek.signals.filtering import ENVELOPE_MARGIN, envelope
from markerseek.signals.pickup import clipped
from markerseek.signals.presets import ProbePreset

BLOCK_ROWS = 32
"""Rows that share one value of the noise floor."""

MIN_CHANNELS = 24
"""Channels that the test for coherence uses at least: fewer could not rule out chance, however well they agree."""

FALSE_PER_FRAME = 1e-3
"""Probability that a source is found in a frame of noise."""

MAX_TESTED = 64
"""Peaks of one frame that are tested for coherence, highest first."""

COHERENT_LEVEL = math.log(MAX_TESTED * 100 / FALSE_PER_FRAME)
"""Coherent energy (see `coherent_energies`) that none of the tested peaks exceeds by chance, ln(tests/p).

Noise is independent from frame to frame, but other interference repeats with every pulse: the false alarms that are
accepted for one frame of noise are shared here by the 100 frames of a search."""

DEAD_SHARE = 0.02
"""A channel is dead when its filtered signal is below this share of the median channel's."""

ENERGY_HALF_S = 1.8e-6
"""Half the time over which a peak's energy is gathered, in seconds: both edge waves of a 6 mm element 25 degrees off
plane, each with both edges of a laser pulse of 0.6 us."""

ENERGY_SIGMAS = 3.0
"""Envelope over the noise from which a sample counts as a peak's energy: noise alone reaches it in one of 90."""

_RAYLEIGH_MEDIAN = math.sqrt(2 * math.log(2))


def noise_profile(envelope: Float32[np.ndarray, "depth lateral"]) -> Float64[np.ndarray, " blocks"]:
    """Return the standard deviation of one quadrature in each block of rows, from the median of its envelope.

    The envelope of Gaussian noise is Rayleigh distributed, with the median sigma sqrt(2 ln 2). Neighbouring pixels
    hold the same noise, so every sixth is enough.
    """
    rows = envelope[: envelope.shape[0] // BLOCK_ROWS * BLOCK_ROWS] if envelope.shape[0] >= BLOCK_ROWS else envelope
    blocks = max(1, rows.shape[0] // BLOCK_ROWS)
    # The median, because the arcs of a source fill less than half of most blocks and hardly move it.
    pixels = np.ascontiguousarray(rows[::2, ::3]).reshape(blocks, -1)
    middle = pixels.shape[1] // 2
    return np.asarray(np.partition(pixels, middle, axis=1)[:, middle].astype(np.float64) / _RAYLEIGH_MEDIAN)


def noise_floor(profile: Float64[np.ndarray, " blocks"]) -> float:
    """Return the standard deviation of one quadrature where there is no source: the median of the blocks.

    The median is taken twice. A source fills some blocks with its arcs, and those drop out as long as they are fewer
    than half; a median over all pixels at once would rise with their share.
    """
    return float(np.median(profile))


def found_level(cells: int, *, false_found: float = FALSE_PER_FRAME) -> float:
    """Return the peak over noise floor that noise alone exceeds with the given probability, sqrt(2 ln(M/p))."""
    return math.sqrt(2 * math.log(cells / false_found))


def coherent_energies(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: Float64[np.ndarray, " points"],
    depth_m: Float64[np.ndarray, " points"],
) -> tuple[Float64[np.ndarray, " points"], Int64[np.ndarray, " points"]]:
    """Return the energy of the sum over the energy of the channels near each point, and the number of channels used.

    Their quotient is the coherence factor, 0 to 1. The window is one over the bandwidth long, as the shortest pulse
    is; the aperture is the image's, and at least `MIN_CHANNELS` wide.
    """
    # Both quadratures must be in the window for the exponential law of chance coherence.
    step = preset.sound_speed_m_s / preset.sampling_hz
    half = max(1, window_samples(preset) // 2)
    depth = np.maximum(depth_m[:, None] + step * np.arange(-half, half + 1), step)
    aperture = half_aperture_m(preset, depth.ravel(), at_least=MIN_CHANNELS / 2).reshape(depth.shape)
    energy = np.empty(len(depth_m))
    used = np.empty(len(depth_m), np.int64)
    kernel.coherent_energies(
        signals, elements_m(preset.array), lateral_m, depth, path_delay(preset), aperture, energy, used
    )
    return energy, used


def energy_in_depth(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: float,
    depth_m: float,
    sigma: float,
) -> tuple[float, float]:
    """Return the centroid and standard deviation in depth of the energy of a peak, in metres.

    Off plane the pulse splits into the edge waves of the element, and a long laser pulse has two edges of its own:
    which of these is the highest is a matter of noise, and the centroid of all is steady. The envelope of the column
    is squared and gathered over `ENERGY_HALF_S` to either side, about the peak first and then about the centroid so
    found. Samples below `ENERGY_SIGMAS` do not count, save the peak.

    ``lateral_m``, ``depth_m``: where the peak is. ``sigma``: standard deviation of the beamformed signal where there is
    no source.
    """
    step = preset.depth_step_m
    half = ENERGY_HALF_S * preset.sound_speed_m_s
    reach = math.ceil(2 * half / step) + ENVELOPE_MARGIN
    rows = depth_m + step * np.arange(-min(reach, math.ceil(depth_m / step) - 1), reach + 1)
    line = envelope(beamform_at(signals, preset, lateral_m=np.array([lateral_m]), depth_m=rows))[:, 0].astype(
        np.float64
    )
    highest = float(line[np.abs(rows - depth_m) <= step].max())
    energy = np.where(line >= min(ENERGY_SIGMAS * sigma, highest), line**2, 0.0)
    # Twice: the window about the peak may cut one edge wave off, that about the centroid holds both.
    middle = depth_m
    for _ in range(2):
        near = np.abs(rows - middle) <= half
        total = float(energy[near].sum())
        if total == 0:
            return depth_m, 0.0
        middle = float(energy[near] @ rows[near]) / total
    return middle, math.sqrt(float(energy[near] @ (rows[near] - middle) ** 2) / total)


def window_samples(preset: ProbePreset) -> int:
    """Return the samples in one over the bandwidth, the length of the shortest pulse."""
    return max(1, round(preset.sampling_hz / (preset.high_hz - preset.low_hz)))


def saturated_channels(
    samples: Int16[np.ndarray, "channels samples"], preset: ProbePreset, *, lateral_m: float, depth_m: float
) -> tuple[tuple[int, ...], int]:
    """Return how many channels of the aperture touch full scale when a point's sound arrives, and of how many."""
    offset = np.abs(elements_m(preset.array) - lateral_m)
    aperture = float(half_aperture_m(preset, np.array([depth_m]))[0])
    per_metre, origin = path_delay(preset)
    middle = np.rint(np.hypot(offset, depth_m) * per_metre + origin).astype(np.int64)
    used = np.flatnonzero((offset <= aperture) & (middle >= 0) & (middle < samples.shape[1]))
    return at_full_scale(samples, preset, rows=used, middle=middle[used], full_scale=preset.full_scale), len(used)


def at_full_scale(
    samples: Int16[np.ndarray, "channels samples"],
    preset: ProbePreset,
    *,
    rows: Int64[np.ndarray, " used"],
    middle: Int64[np.ndarray, " used"],
    full_scale: int,
) -> tuple[int, ...]:
    """Return the rows, channels or lines that touch full scale near their sample in ``middle``.

    The pick-up, which is blanked, does not count.
    """
    # Twice the shortest pulse on each side: a long laser pulse touches full scale for longer.
    half = 2 * window_samples(preset)
    window = np.clip(middle[:, None] + np.arange(-half, half + 1), preset.pickup_samples, samples.shape[1] - 1)
    # As 32 bits, because the magnitude of -32768 does not fit in 16.
    magnitude = np.abs(samples[rows[:, None], window].astype(np.int32))
    return tuple(rows[clipped(magnitude, full_scale=full_scale, recorded=preset.recorded)].tolist())


def dead_channels(signals: Float32[np.ndarray, "samples columns"], *, channels: int) -> tuple[int, ...]:
    """Return the channels without any signal in the band (of every fourth sample); all of them if the frame is zero."""
    inside = signals[::4, PAD : PAD + channels]
    rms = np.sqrt(np.einsum("tc,tc->c", inside, inside) / max(1, len(inside)))
    return tuple(int(c) for c in np.flatnonzero(rms <= DEAD_SHARE * np.median(rms)))
