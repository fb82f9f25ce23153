"""Likelihood of the moments of arrival: the centroid of a peak's energy in time, and its variance.

With t = θ − θp, sound from a marker at radius ρ reaches a face at radius R later by

    D(t) = (sqrt(R² + ρ² − 2Rρ cos t) − (ρ − R))/c                                                             (4)

than in the plane. Off the plane an element receives by its two edges, h sin φ/c apart, φ the incidence. So centroid and
variance of the energy in time are

    τ = τ₀ + (1 + k)·D(t) + δ·(1 − 1/(1 + (t/t₁)²)),                                                           (5)
    s² = a + b·sin² φ(t).                                                                                      (6)

τ₀ holds the trigger offset, k what is not known of R and c; δ is how much later than the pulse in the plane the edges
receive, lens and all; a is the laser's and the absorber's pulse, b = (h/2c)². They are nuisance parameters: each has a
broad normal prior and is integrated out. About the model the moments of the acoustic model's own pulses scatter with
the tails of a Student distribution (150 draws of the physics table, 125 angles each); that, and the noise, is the
scale.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float64, Sample
from markerseek.search.posterior.likelihood import CLEAR_SNR, Scale
from markerseek.search.tolerance import FACE_RADIUS_M

SOUND_SPEED_M_S = 1525.0
"""Middle of its speeds of sound."""

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
"""Power of the likelihood: the errors of one marker's samples are alike, so that four count as one. Taken as
independent they outvote the intensities, by degrees, in one search of some hundred."""

SAME_PLACE_M = 3e-3
"""Largest lateral distance between peaks of one marker, in metres."""

MOST_COUNTED = 24
"""Samples at rest of which more say no more, for the same reason: a scan has a hundred, and the sound of weaker sources
is in the moments of those that are far out. A search has fewer: with 12, two of 60 markers within 0.6° of an end of the
range were no longer told from markers beyond it."""

_ITERATIONS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArrivalMoments:
    """Moments of arrival of the samples that are the marker's."""

    measured_deg: Float64[np.ndarray, " samples"]
    moments_s: Float64[np.ndarray, "samples 2"]
    """Centroid and standard deviation of the energy in time."""
    snr: Float64[np.ndarray, " samples"]
    """Intensities over σ."""
    at_rest: int
    """How many of them are of a probe at rest."""

    def log_likelihood(
        self, angles_deg: Float64[np.ndarray, " angles"], *, knots: int
    ) -> Float64[np.ndarray, " angles"]:
        """Return `log_likelihood` at evenly spaced angles, interpolated between ``knots`` of them."""
        # It bends little over a degree, and costs more than the interpolation.
        at_deg = np.linspace(angles_deg[0], angles_deg[-1], knots)
        log = log_likelihood(at_deg, self.measured_deg, self.moments_s, self.snr)
        return np.asarray(np.interp(angles_deg, at_deg, min(1.0, MOST_COUNTED / max(self.at_rest, 1)) * log))


def moments_of(lit: Sequence[Sample], scale: Scale) -> ArrivalMoments | None:
    """Return the moments of the samples that are clear of the noise and at the marker's place.

    None of fewer than two.
    """
    sigma, marker_m = scale.sigma, scale.marker_m
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
    return ArrivalMoments(
        measured_deg=table[:, 0], moments_s=table[:, 1:3], snr=table[:, 3], at_rest=int(table[:, 4].sum())
    )


@compiled
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
    return (range_m - depth_m) / SOUND_SPEED_M_S, radius_m * np.sin(turned) / range_m


def log_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    measured_deg: Float64[np.ndarray, " samples"],
    moments_s: Float64[np.ndarray, "samples 2"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of (5) and (6) for each angle of the marker, the nuisance parameters integrated out.

    ``angles_deg``: angles of the marker that are considered. ``measured_deg``, ``moments_s``: angles in degrees, and
    centroid and standard deviation in seconds, of samples whose peak is the marker's. ``snr``: their intensities over
    σ.
    """
    # Times count from the strongest sample's, so that the prior of τ₀ is about 0.
    reference_s = float(moments_s[np.argmax(snr), 0])
    shape = (angles_deg.size, measured_deg.size)
    delays, spreads = ((np.empty((*shape, terms)), np.empty(shape), np.empty(shape)) for terms in (3, 2))
    _fill_in(angles_deg, measured_deg, moments_s, snr, reference_s, *delays, *spreads)
    # Priors in the units of the designs: τ₀ ± 50·0.1 µs, k ± 0.16, δ ± 0.1 µs; a ± 30 units of b, b ± 1.
    precision = np.array([1 / 50**2, 1 / DELAY_SHARE**2, 1.0])
    log = student_log_likelihood(*delays, precision, FREEDOM, _ITERATIONS)
    log += student_log_likelihood(*spreads, np.array([1 / 30**2, 1.0]), FREEDOM, _ITERATIONS)
    return np.asarray(WEIGHT * log)


@compiled
def _fill_in(
    angles_deg: Float64[np.ndarray, " angles"],
    measured_deg: Float64[np.ndarray, " samples"],
    moments_s: Float64[np.ndarray, "samples 2"],
    snr: Float64[np.ndarray, " samples"],
    reference_s: float,
    delay_design: Float64[np.ndarray, "angles samples 3"],
    delay: Float64[np.ndarray, "angles samples"],
    delay_scale: Float64[np.ndarray, "angles samples"],
    spread_design: Float64[np.ndarray, "angles samples 2"],
    spread: Float64[np.ndarray, "angles samples"],
    spread_scale: Float64[np.ndarray, "angles samples"],
) -> None:
    """Fill in design, value and scale of the linear models (5), in units of δ, and (6), in units of b·0.3²."""
    # A trigger offset of some µs changes the depth by some mm, and D of (4) by little: τ₀ and k absorb it.
    depth_m = max(SOUND_SPEED_M_S * reference_s, 5e-3)
    height_m2, height_sd_m2 = HEIGHT_M2
    unit = height_m2 * (0.3 / (2 * SOUND_SPEED_M_S)) ** 2
    for k in range(angles_deg.size):
        for i in range(measured_deg.size):
            off_deg = measured_deg[i] - angles_deg[k]
            late_s, sine = off_plane(off_deg, FACE_RADIUS_M, depth_m)
            lobes = abs(off_deg) / LOBE_DEG
            delay_design[k, i, 0] = 1.0
            delay_design[k, i, 1] = late_s / EDGE_DELAY_S
            delay_design[k, i, 2] = 1 - 1 / (1 + lobes**2)
            delay[k, i] = (moments_s[i, 0] - reference_s - late_s) / EDGE_DELAY_S
            # Scatter of the acoustic model's own pulses about (5), largest where face and edges are equally strong; the
            # noise of a centroid falls with the intensity.
            model_s = 15e-9 + 30e-9 * lobes * math.exp(1 - lobes)
            delay_scale[k, i] = math.hypot(model_s, 0.22e-6 / snr[i]) / EDGE_DELAY_S

            # b·sin² φ of (6), less its mean over the heights of elements.
            edges = (sine / (2 * SOUND_SPEED_M_S)) ** 2
            variance = moments_s[i, 1] ** 2
            spread_design[k, i, 0] = 1.0
            spread_design[k, i, 1] = height_sd_m2 * edges / unit
            spread[k, i] = (variance - height_m2 * edges) / unit
            model = 0.05 + 0.2 * height_m2 * edges / unit
            spread_scale[k, i] = math.hypot(model, 2.5 / snr[i] * (variance / unit))


@compiled
def solve(matrix: Float64[np.ndarray, "terms columns"], beta: Float64[np.ndarray, " terms"]) -> float:
    """Solve the symmetric system whose last column is its right side, by elimination; return half of ln det."""
    # Without pivots, for the matrix is positive definite; 2.5 times as fast as LAPACK through Numba for 3 terms
    # (`benchmarks.kernels`), which would also factor twice for the determinant.
    terms = beta.size
    half_log_det = 0.0
    for m in range(terms):
        half_log_det += 0.5 * math.log(matrix[m, m])
        for lower in range(m + 1, terms):
            part = matrix[lower, m] / matrix[m, m]
            for n in range(m, terms + 1):
                matrix[lower, n] -= part * matrix[m, n]
    for m in range(terms - 1, -1, -1):
        total = matrix[m, terms]
        for n in range(m + 1, terms):
            total -= matrix[m, n] * beta[n]
        beta[m] = total / matrix[m, m]
    return half_log_det


@compiled
def _residuals(
    design: Float64[np.ndarray, "samples terms"],
    value: Float64[np.ndarray, " samples"],
    scale: Float64[np.ndarray, " samples"],
    beta: Float64[np.ndarray, " terms"],
    out: Float64[np.ndarray, " samples"],
) -> None:
    for i in range(value.size):
        rest = value[i]
        for m in range(beta.size):
            rest -= design[i, m] * beta[m]
        out[i] = rest / scale[i]


@compiled
def student_log_likelihood(
    design: Float64[np.ndarray, "angles samples terms"],
    value: Float64[np.ndarray, "angles samples"],
    scale: Float64[np.ndarray, "angles samples"],
    precision: Float64[np.ndarray, " terms"],
    freedom: float,
    iterations: int,
) -> Float64[np.ndarray, " angles"]:
    """Ln of the likelihood of value = design·β + scale·Student for each angle, β integrated out by Laplace's method.

    β has independent normal priors about 0. The mode is found by reweighted least squares.
    """
    angles, samples, terms = design.shape
    out = np.empty(angles)
    matrix = np.empty((terms, terms + 1))
    beta = np.zeros(terms)
    residual = np.empty(samples)
    for k in range(angles):
        residual[:] = 0.0
        half_log_det = 0.0
        for _ in range(iterations):
            matrix[:, :] = 0.0
            for m in range(terms):
                matrix[m, m] = precision[m]
            for i in range(samples):
                # Weight of a Student residual in least squares (O'Leary 1990): outliers count less in each iteration.
                share = (freedom + 1) / (freedom + residual[i] ** 2) / scale[k, i] ** 2
                for m in range(terms):
                    matrix[m, terms] += share * design[k, i, m] * value[k, i]
                    for n in range(terms):
                        matrix[m, n] += share * design[k, i, m] * design[k, i, n]
            half_log_det = solve(matrix, beta)
            _residuals(design[k], value[k], scale[k], beta, residual)
        # Laplace: ln p at the mode less half of ln det of the precision there; constants in the angle are left out.
        log = -half_log_det
        for m in range(terms):
            log -= 0.5 * precision[m] * beta[m] ** 2
        for i in range(samples):
            log -= math.log(scale[k, i]) + (freedom + 1) / 2 * math.log1p(residual[i] ** 2 / freedom)
        out[k] = log
    return out
