"""Coherence at the best focus: whether all the sound about a peak comes from one point.

At a peak of the image the coherence is low for a point too where the speed of sound is wrong, and high for a spot where
one of its absorbers outshines the others. Here the sound of a microsecond to either side counts, in which all absorbers
of a spot of some millimetres arrive, and the place along the array and the speed of sound are sought at which most of
it is in phase:

    C = max over x, c of Σ_t (Σ_e s_e(t + τ_e(x, c)))² / (n·Σ_t Σ_e s_e(t + τ_e(x, c))²),

the coherence factor (Mallart and Fink, J. Acoust. Soc. Am. 96, 3721 (1994)) of the n channels s_e with their delays τ_e
to a point at x. It is 1 for a point, whatever the pulse. The speed makes up for a wrong trigger offset as well, because
only the curvature of the delays counts.
"""

from __future__ import annotations

import numpy as np

from markerseek.core import Float32
from markerseek.signals._kernel import PAD, aligned_energies
from markerseek.signals.beamform import elements_m, half_aperture_m, path_delay
from markerseek.signals.features import MIN_CHANNELS
from markerseek.signals.presets import ProbePreset

MIN_SNR = 12.0
"""Envelope over the noise from which the coherence at the best focus is computed: below, noise decides it."""

WINDOW_S = 1e-6
"""Half the time over which the sound counts, in seconds: 1.5 mm of path."""

SPEEDS = np.linspace(0.92, 1.06, 8)
"""Speeds of sound over the stated one: 1450 to 1600 over 1540 m/s, with a trigger offset of 1 us."""

ASIDE_M = np.linspace(-2.4e-3, 2.4e-3, 13)
"""Places along the array beside the peak, in metres: at a wrong speed the image of a point may be split in two."""

_FINER = np.linspace(-1.0, 1.0, 7)
_NORMAL_MEDIAN = 0.6745


def focused_coherence(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: float,
    depth_m: float,
    intensity: float,
    sigma: float,
) -> float | None:
    """Return the share of the energy about a peak that is in phase at its best focus, noise apart, 0 to 1.

    It is None of a peak too weak for it, which noise would decide.

    ``lateral_m``, ``depth_m``, ``intensity``: where the peak is, in metres, and its envelope. ``sigma``: standard
    deviation of the beamformed signal where there is no source.
    """
    if intensity < MIN_SNR * sigma:
        return None
    half = 2 * round(WINDOW_S * preset.sampling_hz / 2)
    aperture_m = float(half_aperture_m(preset, np.array([depth_m]), at_least=MIN_CHANNELS / 2)[0])
    per_metre, origin = path_delay(preset)
    speeds = SPEEDS
    places_m = lateral_m + ASIDE_M
    for step in (1.0, 1 / 3, 1 / 9):
        points = len(speeds) * len(places_m)
        of_sum = np.empty(points)
        of_channels = np.empty(points)
        used = np.empty(points, np.int64)
        aligned_energies(
            signals,
            elements_m(preset.array),
            np.tile(places_m, len(speeds)),
            np.repeat(per_metre / speeds, len(places_m)),
            (depth_m * per_metre, origin),
            half,
            aperture_m,
            of_sum,
            of_channels,
            used,
        )
        best = int(np.argmax(of_sum / np.maximum(of_channels, np.finfo(float).tiny)))
        speed = speeds[best // len(places_m)]
        place_m = places_m[best % len(places_m)]
        # About the best, one step to either side, in a third of the steps.
        speeds = speed + step * (SPEEDS[1] - SPEEDS[0]) * _FINER
        places_m = place_m + step * (ASIDE_M[1] - ASIDE_M[0]) * _FINER
    # Noise adds its energy to each channel, and as much as that of one channel to the sum over the root of n.
    # What is blanked holds none.
    inside = signals[preset.pickup_samples :: 8, PAD : PAD + preset.array.elements : 4]
    channel_sigma = float(np.median(np.abs(inside))) / _NORMAL_MEDIAN
    in_phase = float(of_sum[best]) - (half + 1) * sigma**2
    whole = float(of_channels[best]) - (half + 1) * int(used[best]) * channel_sigma**2
    return min(1.0, max(0.0, in_phase / whole)) if whole > 0 else None
