"""A parabola through the top of a curve: where its vertex is, and how uncertain that is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.search.curve import Curve

TOP_SHARE = 0.7
"""Samples not below this share of the largest belong to the top: a Gaussian is a parabola there to 3 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Top:
    """Vertex of the top of a curve."""

    vertex_deg: float
    sigma_deg: float


def fit_top(curve: Curve, *, step_deg: float, noise_sigma: float) -> Top:
    """Return the vertex of the least-squares parabola S ≈ a + b·t + c·t² through the top, t counted from its middle.

    Vertex −b/(2c); its variance is gᵀ·C·g with g = (0, −1/(2c), b/(2c²)) and C = s²·(XᵀX)⁻¹, where s² is σ² or the
    scatter about the parabola, whichever is larger. Added is 0.5·θd/(n + 1) for a top that is not a parabola, n the
    number of samples that reach half maximum: not derived, but what covers noise-free curves from a cusp, 1/(1 + 2|t|),
    to a Gaussian with steps of 0.15 to 1.2 of their width.

    The top is the run of samples round the largest that are not below `TOP_SHARE` of it, with one neighbour on each
    side where the run is shorter than three. Without a vertex in it (no bend downwards, fewer than three samples,
    the same angle three times) the largest sample answers, uncertain by the step to its neighbours or the run's width,
    whichever is larger, over √3.

    Over the curves of `average_sigma_deg`, 141 samples, ±1.96 standard deviations hold the marker in 95 to 99.7 % of
    searches (Monte Carlo of 400 each).

    ``step_deg``: step θd of the sweep. ``noise_sigma``: standard deviation σ of one intensity, in its unit; 0 for none.
    """
    first, last = _top_run(curve)
    largest = float(curve.intensity[curve.strongest])
    peak_deg = float(curve.angle_deg[curve.strongest])
    unresolved = Top(
        vertex_deg=peak_deg,
        sigma_deg=max(step_deg, float(curve.angle_deg[last - 1] - curve.angle_deg[first])) / math.sqrt(3),
    )
    angle_deg = curve.angle_deg[first:last]
    scale_deg = float(np.ptp(angle_deg)) / 2
    if largest == 0 or np.unique(angle_deg).size < 3:
        return unresolved
    middle_deg = float(angle_deg[0]) + scale_deg
    t = (angle_deg - middle_deg) / scale_deg
    # Centred and scaled to ±1, the normal equations are well conditioned.
    powers = np.stack([np.ones_like(t), t, t**2], axis=-1)
    height = curve.intensity[first:last] / largest
    coefficients, _, rank, _ = np.linalg.lstsq(powers, height, rcond=None)
    _, slope, bend = (float(value) for value in coefficients)
    # A flat top bends by rounding alone.
    if rank < 3 or bend > -1e-9 or abs(slope) > 2 * abs(bend):
        return unresolved
    vertex = -slope / (2 * bend)
    scatter = float(np.sum((height - powers @ coefficients) ** 2)) / max(1, t.size - 3)
    variance = max((noise_sigma / largest) ** 2, scatter)
    resolved = np.count_nonzero(curve.intensity >= largest / 2)
    gradient = np.array([0.0, -1 / (2 * bend), slope / (2 * bend**2)])
    vertex_variance = variance * float(gradient @ np.linalg.inv(powers.T @ powers) @ gradient)
    return Top(
        vertex_deg=middle_deg + scale_deg * vertex,
        sigma_deg=math.hypot(scale_deg * math.sqrt(vertex_variance), 0.5 * step_deg / (resolved + 1)),
    )


def _top_run(curve: Curve) -> tuple[int, int]:
    """Half-open run of samples round the largest that reach `TOP_SHARE`, widened to three where there are so many."""
    top = curve.strongest
    level = TOP_SHARE * curve.intensity[top]
    first = last = top
    while first > 0 and curve.intensity[first - 1] >= level:
        first -= 1
    while last < len(curve) - 1 and curve.intensity[last + 1] >= level:
        last += 1
    if last - first < 2:
        first, last = max(0, top - 1), min(len(curve) - 1, top + 1)
    return first, last + 1
