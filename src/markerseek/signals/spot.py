"""Energy of a spot in the image: the squared envelope over its extent, less what noise gives, and its centroid.

The peak pixel of a stained spot is a sum of grains whose phases change with the angle. The sum of the squared envelope
over the spot averages that: the centre of its curve over the angles, and its centroid along the array, lie nearer to
the marker than those of the peak (docs/validation/answers.md). The channels' energy along the wavefront, added
without phase, is as steady, but holds what any other source sends at the same time.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import Float32, Float64, SpotEnergy

HALF_WIDTH_M = 4e-3
"""Half the width over which the energy is gathered along the array, in metres: spots of up to 5 mm."""

HALF_DEPTH_M = 2e-3
"""Half the depth, in metres: both edge waves of an element 15 degrees off plane, each of a long pulse."""

LARGEST_RELATIVE_SIGMA = 0.25
"""Relative standard deviation of the amplitude above which noise decides it."""

_ROUNDS = 3
"""Times that the window is moved to the centroid in it."""


def spot_energy(
    envelope: Float32[np.ndarray, "depth lateral"],
    *,
    at_lateral_m: Float64[np.ndarray, " lateral"],
    at_depth_m: Float64[np.ndarray, " depth"],
    lateral_m: float,
    depth_m: float,
    sigma: float,
    cell_pixels: float,
) -> SpotEnergy | None:
    """Return the energy about a peak, and its centroid; None if noise decides it.

    ``at_lateral_m``, ``at_depth_m``: columns and rows of the image, ascending. ``lateral_m``, ``depth_m``: where the
    peak is. ``sigma``: standard deviation of the beamformed signal where there is no source. ``cell_pixels``: pixels of
    a resolution cell, from `noise_gain.cell_pixels`.
    """
    place_m = lateral_m, depth_m
    for _ in range(_ROUNDS):
        columns = _within(at_lateral_m, place_m[0], HALF_WIDTH_M)
        rows = _within(at_depth_m, place_m[1], HALF_DEPTH_M)
        # The squared envelope of noise is 2σ² in the mean.
        power = envelope[rows, columns].astype(np.float64) ** 2 - 2 * sigma**2
        total = float(power.sum())
        if total <= 0:
            return None
        place_m = (
            float(power.sum(axis=0) @ at_lateral_m[columns]) / total,
            float(power.sum(axis=1) @ at_depth_m[rows]) / total,
        )
        if abs(place_m[0] - lateral_m) > HALF_WIDTH_M or abs(place_m[1] - depth_m) > HALF_DEPTH_M:
            return None
    # |signal + noise|² has the variance 4σ²·|signal|² + 4σ⁴, and is the same over the pixels of a cell.
    spread = 2 * sigma * math.sqrt(cell_pixels * (total + power.size * sigma**2))
    relative_sigma = max(spread / (2 * total), np.finfo(float).eps)
    if relative_sigma > LARGEST_RELATIVE_SIGMA:
        return None
    return SpotEnergy(
        amplitude=math.sqrt(total / cell_pixels),
        relative_sigma=relative_sigma,
        lateral_m=place_m[0],
        depth_m=place_m[1],
    )


def _within(at_m: Float64[np.ndarray, " places"], middle_m: float, half_m: float) -> slice:
    first, end = np.searchsorted(at_m, (middle_m - half_m, middle_m + half_m))
    return slice(int(first), int(end))
