"""Likelihood of the arrival: centroid and spread of a peak's energy in time.

With t = θ − θp, sound from a marker at radius ρ reaches a face at radius R later by

    D(t) = (sqrt(R² + ρ² − 2Rρ cos t) − (ρ − R))/c                                                             (4)

than in the plane. Off the plane an element receives by its two edges, h sin φ/c apart, φ the incidence. So centroid and
variance of the energy in time are

    τ = τ₀ + (1 + k)·D(t) + δ·(1 − 1/(1 + (t/t₁)²)),                                                           (5)
    s² = a + b·sin² φ(t).                                                                                      (6)

τ₀ holds the trigger offset, k what is not known of R and c; δ is how much later than the pulse in the plane the edges
receive, lens and all; a is the laser's and the absorber's pulse, b = (h/2c)². They are nuisance parameters: each has a
broad normal prior and is integrated out. About (5) and (6), centroid and variance of the acoustic model's own pulses
scatter with the tails of a Student distribution (150 draws of the physics table, 125 angles each); that, and the
noise, is the scale.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial

import numpy as np

from markerseek.core import USUAL_FACE_RADIUS_M, USUAL_SOUND_SPEED_M_S, Float64, Sample
from markerseek.search.posterior.likelihood import CLEAR_SNR, Scale

DELAY_SHARE = 0.16
"""Standard deviation of k: R of 8 to 12 mm and the speed of sound."""

LOBE_DEG = 3.5
"""Angle t₁ from which the sound at an element's edges exceeds that at its face, in degrees."""

EDGE_DELAY_S = 0.1e-6
"""Standard deviation of δ, in seconds."""

HEIGHT_M2 = (20e-6, 10e-6)
"""Mean and standard deviation of the squared height h² of an element, 3 to 6 mm; in square metres."""

FREEDOM = 4.0
"""Degrees of freedom of the Student distributions."""

WEIGHT = 0.25
"""Power of the likelihood: the errors of one marker's samples are alike, so that four count as one. Counted as
independent, they moved the answer by several degrees in about one search in a hundred."""

SAME_PLACE_M = 3e-3
"""Largest lateral distance between peaks of one marker, in metres."""

MOST_COUNTED = 24
"""Most samples at rest that count, for the same reason: a scan has a hundred, and the arrival times of those far from
the marker contain the sound of weaker sources. A search has fewer: with a limit of 12, two of 60 markers within 0.6° of
an end of the range were no longer distinguished from markers beyond it."""

OFFSET_SIGMA_S = 50 * EDGE_DELAY_S
"""Standard deviation of τ₀ about the centroid of the strongest sample: broad on purpose."""

CENTROID_FACE_S = 15e-9
"""Scatter of the acoustic model's centroids about (5) in the plane (150 draws of the physics table)."""

CENTROID_EDGE_S = 30e-9
"""What that scatter grows by at `LOBE_DEG`, where face and edges are equally strong; of the same draws."""

CENTROID_NOISE_S = 0.22e-6
"""Standard deviation of a centroid by noise, times the SNR."""

UNIT_SINE = 0.3
"""Sine of the incidence at which b·sin² φ of an element of mean height is the unit of the variances."""

VARIANCE_SIGMA = 30.0
"""Standard deviation of a in that unit: so broad that it says nothing."""

VARIANCE_FACE = 0.05
"""Scatter of the acoustic model's variances about (6) in the plane, in that unit; of the same draws."""

VARIANCE_EDGE = 0.2
"""What that scatter grows by, over b·sin² φ; of the same draws."""

VARIANCE_NOISE = 2.5
"""Standard deviation of a variance by noise, over the variance and times the SNR."""

ITERATIONS = 3
"""Steps of reweighted least squares."""

KNOTS_DEG = 1.0
"""Distance between the angles at which the likelihood is computed; a cubic spline joins them."""


def arrival_likelihood(
    lit: Sequence[Sample], scale: Scale, low_deg: float, high_deg: float
) -> Callable[[Float64[np.ndarray, "*n"]], Float64[np.ndarray, "*n"]] | None:
    """Return ln of the likelihood as a function of the marker's angle, between two angles in degrees.

    It is that of the samples that are clear of the noise and at the marker's place; None of fewer than two.
    """
    sigma = scale.sigma
    marker_m = scale.marker_m
    rows = [
        (sample.angle_deg, reading.centroid_s, reading.spread_s, reading.intensity / sigma, sample.sweep is None)
        for sample in lit
        if (reading := sample.reading).centroid_s is not None
        and reading.spread_s is not None
        and reading.intensity > CLEAR_SNR * sigma
        and (marker_m is None or reading.lateral_m is None or abs(reading.lateral_m - marker_m) < SAME_PLACE_M)
    ]
    if len(rows) < 2:
        return None
    table = np.array(rows, dtype=np.float64)
    at_rest = int(table[:, 4].sum())
    knots_deg = np.linspace(low_deg, high_deg, math.ceil((high_deg - low_deg) / KNOTS_DEG) + 1)
    log = log_likelihood(knots_deg, table[:, 0], table[:, 1:3], table[:, 3])
    values = min(1.0, MOST_COUNTED / max(at_rest, 1)) * log
    return partial(_spline, low_deg, (high_deg - low_deg) / (len(values) - 1), values, _bending(len(values)) @ values)


# scipy.interpolate has it too, and its import would lengthen the start of every search by a tenth of a second.
def _spline(
    low: float,
    step: float,
    values: Float64[np.ndarray, " knots"],
    bending: Float64[np.ndarray, " knots"],
    at: Float64[np.ndarray, "*n"],
) -> Float64[np.ndarray, "*n"]:
    """Return the cubic spline through values at even knots, with its second differences there."""
    places = (at - low) / step
    left = np.clip(places.astype(int), 0, len(values) - 2)
    after = places - left
    before = 1 - after
    spline: Float64[np.ndarray, "*n"] = (
        before * values[left]
        + after * values[left + 1]
        + ((before**3 - before) * bending[left] + (after**3 - after) * bending[left + 1]) / 6
    )
    return spline


@lru_cache(maxsize=64)
def _bending(knots: int) -> Float64[np.ndarray, "knots knots"]:
    """Return what makes the second derivatives of a spline, times the step squared, of its values.

    With not-a-knot ends.
    """
    if knots < 4:
        # A line, or a parabola.
        return np.tile([1.0, -2.0, 1.0], (3, 1)) if knots == 3 else np.zeros((knots, knots))
    inside = np.eye(knots, k=-1) + 4 * np.eye(knots) + np.eye(knots, k=1)
    inside[[0, -1]] = 0.0
    inside[0, :3] = (1.0, -2.0, 1.0)
    inside[-1, -3:] = (1.0, -2.0, 1.0)
    differences = 6 * (np.eye(knots, k=-1) - 2 * np.eye(knots) + np.eye(knots, k=1))
    differences[[0, -1]] = 0.0
    return np.linalg.solve(inside, differences)


def off_plane(
    distance_deg: Float64[np.ndarray, "*shape"], face_radius_m: float, depth_m: float
) -> tuple[Float64[np.ndarray, "*shape"], Float64[np.ndarray, "*shape"]]:
    """Return D of (4), how much later sound arrives off the plane, in seconds, and the sine of its incidence.

    Parameters
    ----------
    distance_deg
        Angles t off the plane, in degrees.
    face_radius_m
        Distance R of the face from the axis, in metres.
    depth_m
        Distance of the marker from the face in the plane, in metres.
    """
    radius_m = face_radius_m + depth_m
    turned = np.radians(distance_deg)
    range_m = np.sqrt(face_radius_m**2 + radius_m**2 - 2 * face_radius_m * radius_m * np.cos(turned))
    return (range_m - depth_m) / USUAL_SOUND_SPEED_M_S, radius_m * np.sin(turned) / range_m


def log_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    measured_deg: Float64[np.ndarray, " samples"],
    centroid_and_spread_s: Float64[np.ndarray, "samples 2"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of (5) and (6) for each angle of the marker, the nuisance parameters integrated out.

    ``angles_deg``: angles of the marker that are considered. ``measured_deg``, ``centroid_and_spread_s``: angles in
    degrees, and centroid and standard deviation in seconds, of samples whose peak is the marker's. ``snr``: their
    intensities over σ.
    """
    # Times count from the strongest sample's, so that the prior of τ₀ is about 0.
    centroid_s, spread_s = centroid_and_spread_s.T
    reference_s = float(centroid_s[np.argmax(snr)])
    # A trigger offset of some µs changes the depth by some mm, and D of (4) by little: τ₀ and k absorb the offset.
    off_deg = measured_deg - angles_deg[:, None]
    late_s, sine = off_plane(off_deg, USUAL_FACE_RADIUS_M, max(USUAL_SOUND_SPEED_M_S * reference_s, 5e-3))
    log = _centroid_log_likelihood(centroid_s - reference_s, late_s, np.abs(off_deg) / LOBE_DEG, snr)
    return np.asarray(WEIGHT * (log + _spread_log_likelihood(spread_s, sine, snr)))


def _centroid_log_likelihood(
    centroid_s: Float64[np.ndarray, " samples"],
    late_s: Float64[np.ndarray, "angles samples"],
    lobes: Float64[np.ndarray, "angles samples"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of (5); ``late_s``: D(t); ``lobes``: t over t₁, without its sign."""
    # In units of the prior of δ.
    design = np.stack([np.ones_like(lobes), late_s / EDGE_DELAY_S, 1 - 1 / (1 + lobes**2)], axis=-1)
    delay = (centroid_s - late_s) / EDGE_DELAY_S
    scatter_s = CENTROID_FACE_S + CENTROID_EDGE_S * lobes * np.exp(1 - lobes)
    scale = np.hypot(scatter_s, CENTROID_NOISE_S / snr) / EDGE_DELAY_S
    precision = np.array([(EDGE_DELAY_S / OFFSET_SIGMA_S) ** 2, 1 / DELAY_SHARE**2, 1.0])
    return student_log_likelihood(design, delay, scale, precision)


def _spread_log_likelihood(
    spread_s: Float64[np.ndarray, " samples"],
    sine: Float64[np.ndarray, "angles samples"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of (6); ``sine``: sin φ(t)."""
    # Less the mean over the heights of elements: what is left of b has the prior 0 ± 1.
    height_m2, height_sd_m2 = HEIGHT_M2
    unit_s2 = height_m2 * (UNIT_SINE / (2 * USUAL_SOUND_SPEED_M_S)) ** 2
    edges = (sine / (2 * USUAL_SOUND_SPEED_M_S)) ** 2 / unit_s2
    design = np.stack([np.ones_like(edges), height_sd_m2 * edges], axis=-1)
    variance = spread_s**2 / unit_s2
    scale = np.hypot(VARIANCE_FACE + VARIANCE_EDGE * height_m2 * edges, VARIANCE_NOISE / snr * variance)
    precision = np.array([1 / VARIANCE_SIGMA**2, 1.0])
    return student_log_likelihood(design, variance - height_m2 * edges, scale, precision)


def student_log_likelihood(
    design: Float64[np.ndarray, "angles samples terms"],
    value: Float64[np.ndarray, "angles samples"],
    scale: Float64[np.ndarray, "angles samples"],
    precision: Float64[np.ndarray, " terms"],
    *,
    iterations: int = ITERATIONS,
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of value = design·β + scale·Student for each angle, β integrated out.

    By Laplace's method: β has independent normal priors about 0, and its mode is found by reweighted least squares.
    Constants in the angle are left out.
    """
    residual = np.zeros_like(value)
    across = np.swapaxes(design, 1, 2)
    for _ in range(iterations):
        # Weight of a Student residual in least squares (O'Leary 1990): outliers count less in each iteration.
        share = (FREEDOM + 1) / (FREEDOM + residual**2) / scale**2
        weighted = across * share[:, None, :]
        hessian = weighted @ design + np.diag(precision)
        beta = np.linalg.solve(hessian, weighted @ value[:, :, None])
        residual = (value - (design @ beta)[:, :, 0]) / scale
    # ln p at the mode, less half of ln det of the precision there.
    log = -0.5 * np.linalg.slogdet(hessian)[1] - 0.5 * (beta[:, :, 0] ** 2 @ precision)
    return np.asarray(log - (np.log(scale) + (FREEDOM + 1) / 2 * np.log1p(residual**2 / FREEDOM)).sum(axis=1))
