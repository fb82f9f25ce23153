"""Two humps: whether the samples at one place are of one curve, or of two with a dip between them.

A curve rises to its top and falls again. Where samples on both sides of another are stronger by more than noise and the
laser's energy explain, there are two curves, and the samples are divided at the dip into those of either. Only a source
in the near field of an element has a dip of its own, a quarter deep at most (2): in a frame, which resolves places,
a dip must be deeper than that. In a file of intensities either is possible, and the answer is `Ambiguous`.

A dip shows only if it was measured: `top_deg` and `gap_angle_deg` name the angles at which that is still to be done, in
the top of the curve, and beside a sample that is stronger than one nearer to its centre (`asymmetric_sample`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from markerseek.core import Float64, Sample
from markerseek.search.posterior.angle_posterior import AnglePosterior

DIP_SIGMAS, DOUBTFUL_DIP_SIGMAS = 3.0, 2.0
"""Standard deviations of noise and laser by which a dip must be deeper than both humps, and for doubt."""

SAMPLE_ERROR = 0.03
"""Relative error of one sample by itself, the laser's energy."""

MIN_DIP, NEAR_FIELD_DIP = 0.1, 0.35
"""Least depth of a dip over the lower hump, for intensities alone, and for frames, where the near field is excluded."""

ALIKE_DEG = 1.0
"""Samples nearer than this are alike on any curve: a burst or a misfire among them is neither hump nor dip."""

HUMPS_APART_DEG = 5.0
"""Least distance of two humps, in degrees: nearer ones are absorbers of one stained spot, which interfere."""

ASYMMETRY_SHARE = 0.2
"""Least share of a sample's intensity by which one nearer to the centre must be weaker, on either side, for doubt."""

TOP_SHARES = (-0.35, 0.0, 0.35)
"""Angles about the answer, over the full width at half maximum, at which a dip would show."""

TOP_REACH = 0.25
"""Distance from such an angle, over the same width, at which a sample serves as well."""


def dip_deg(at: Sequence[Sample], *, sigma: float, level: float, single: bool = False) -> float | None:
    """Return the angle of the deepest dip between two humps, in degrees; None without one.

    ``sigma``: noise of one intensity, in its unit. ``level``: largest intensity that noise reaches; both humps must be
    above it. ``single``: whether intensities alone need a dip as deep as frames do.
    """
    if len(at) < 3:
        return None
    order = sorted(at, key=lambda sample: sample.angle_deg)
    angle_deg = np.array([sample.angle_deg for sample in order])
    hump, bottom = _without_outliers(angle_deg, _heights(order))
    has_positions = all(sample.reading.local_maxima is not None for sample in at)
    lower = np.minimum(np.maximum.accumulate(hump)[:-2], np.maximum.accumulate(hump[::-1])[::-1][2:])
    drop = lower - bottom[1:-1]
    least = np.maximum(
        DIP_SIGMAS * np.hypot(1.5 * sigma, SAMPLE_ERROR * lower),
        (NEAR_FIELD_DIP if has_positions or single else MIN_DIP) * lower,
    )
    # Where the humps are that a sample lies between.
    inner = np.arange(1, len(order) - 1)
    apart_deg = np.array(
        [angle_deg[k + 1 + np.argmax(hump[k + 1 :])] - angle_deg[np.argmax(hump[:k])] for k in inner.tolist()]
    )
    # An angle measured twice lies between no others where it is the first or the last: the marker has moved.
    between = (angle_deg[1:-1] > angle_deg[0]) & (angle_deg[1:-1] < angle_deg[-1])
    deep = np.where((drop > least) & (lower > level) & (apart_deg >= HUMPS_APART_DEG) & between, drop, 0.0)
    return float(angle_deg[1:-1][np.argmax(deep)]) if deep.any() else None


def _heights(order: Sequence[Sample]) -> Float64[np.ndarray, " samples"]:
    """Intensities; of a sample of a sweep the median of those about it, for one pulse of hundreds may be weak."""
    height = np.array([sample.reading.intensity for sample in order])
    angle_deg = np.array([sample.angle_deg for sample in order])
    sweep = np.array([0 if sample.sweep is None else sample.sweep.number for sample in order])
    alike = (np.abs(angle_deg[:, None] - angle_deg) <= ALIKE_DEG / 2) & (sweep[:, None] == sweep)
    return np.array(
        [float(np.median(height[alike[k]])) if sweep[k] else float(height[k]) for k in range(len(order))],
        dtype=np.float64,
    )


def _without_outliers(
    angle_deg: Float64[np.ndarray, " samples"], height: Float64[np.ndarray, " samples"]
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Intensities as those of humps and as those of dips: a burst makes no hump, and a misfire no dip."""
    near = np.abs(angle_deg[:, None] - angle_deg) <= ALIKE_DEG
    np.fill_diagonal(near, False)
    hump, bottom = height.copy(), height.copy()
    for k in np.flatnonzero(near.any(axis=1)).tolist():
        # Within a degree no curve changes by more than to a half.
        hump[k] = min(height[k], 2.0 * height[near[k]].max())
        bottom[k] = max(height[k], 0.5 * height[near[k]].min())
    return hump, bottom


def top_deg(posterior: AnglePosterior, measured_deg: Sequence[float]) -> float | None:
    """Return an angle in the top of the curve where a dip may still hide; None where samples would have shown it.

    ``measured_deg``: angles measured so far.
    """
    for share in TOP_SHARES:
        angle_deg = posterior.mean_deg + share * posterior.fwhm_deg
        apart = min((abs(angle_deg - each) for each in measured_deg), default=math.inf)
        if apart > TOP_REACH * posterior.fwhm_deg:
            return angle_deg
    return None


def asymmetric_sample(at: Sequence[Sample], *, centre_deg: float, sigma: float, level: float) -> Sample | None:
    """Return the sample that is stronger than one nearer to the centre, by the largest difference; None without one.

    A curve that is symmetric and falls from its centre has none: the sample is of another curve.
    """
    order = sorted(at, key=lambda sample: abs(sample.angle_deg - centre_deg))
    angle_deg = np.array([sample.angle_deg for sample in order])
    hump, bottom = _without_outliers(angle_deg, _heights(order))
    drop = hump - np.minimum.accumulate(bottom)
    least = np.maximum(DOUBTFUL_DIP_SIGMAS * np.hypot(1.5 * sigma, SAMPLE_ERROR * hump), ASYMMETRY_SHARE * hump)
    excess = np.where((drop > least) & (hump > level), drop, 0.0)
    return order[int(np.argmax(excess))] if excess.any() else None


def gap_angle_deg(angle_deg: float, measured_deg: Sequence[float]) -> float | None:
    """Return the middle of the wider gap beside a measured angle, in degrees; None where both are narrow."""
    gaps = []
    for side in (-1.0, 1.0):
        away = min((side * (each - angle_deg) for each in measured_deg if side * (each - angle_deg) > 0), default=0.0)
        gaps.append((away, angle_deg + side * away / 2))
    widest, middle_deg = max(gaps)
    return middle_deg if widest > 2 * ALIKE_DEG else None
