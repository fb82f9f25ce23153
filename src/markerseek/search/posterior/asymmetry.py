"""How far the centre of the intensity curve may lie from the marker: a nuisance parameter of asymmetric markers.

The curve of a point is symmetric. That of a stained spot is not: its absorbers interfere, and the centre of the curve
lies some tenths of a millimetre beside the centroid of the spot; tissue on the way shifts it as well. All
samples of one curve share its centre, so that more of them do not show the shift: it is a bias, and the posterior is
widened by it,

    p(θ) = (1 − u)·q(θ) + u·∫ q(θ') t₄((θ − θ')·ρ/a) dθ'·ρ/a,                                                (10)

with q the posterior of the centre, u the probability that the marker is such a spot, ρ its distance from the axis, and
t₄ Student's density with four degrees of freedom, for most spots are shifted by little and some by much (it was more
likely than a normal density by exp(18) on 285 simulated spots).

All sound of a point is in phase over the array at its best focus (`Reading.focused_coherence`, C), whatever its pulse
and the speed of sound; that of a spot wider than the array resolves is not. Bayes' rule gives u from the mean of C over
the samples: that of a point is normal about `POINT_COHERENCE`, that of a spot uniform over `SPOT_COHERENCES`. Two
sources that sound at once are taken for a spot: the interval is then too wide rather than too narrow. The less of the
sound is in phase, the wider is the spot, and the larger its shift: a = a₀ + a₁·(1 − C).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from markerseek.core import Float64, Sample
from markerseek.search.posterior.arrival import FACE_RADIUS_M

PRIOR = 0.3
"""Prior probability of an asymmetric marker."""

SHIFT_M, WIDE_SHIFT_M = 0.12e-3, 0.26e-3
"""a₀ and a₁ in metres: the most likely ones of 285 simulated spots of 0.4 to 1.2 mm radius, whose root mean square
shifts were 0.21 mm (the smallest) to 0.33 mm (the largest), whatever the curve's width."""

USUAL_COHERENCE = 0.7
"""Coherence of a spot where frames do not say it."""

USUAL_RADIUS_M = 55e-3
"""Distance of the marker from the axis in metres, where frames do not say it."""

POINT_COHERENCE, POINT_SIGMA, NOISE_SIGMA = 0.997, 0.005, 0.5
"""Coherence of a point at its best focus, standard deviation from point to point, and that by noise times the SNR: of
120 simulated points with all that is unknown drawn."""

SPOT_COHERENCES = 0.35, 1.0
"""Coherences of spots: those of 95 % of 160 simulated ones of 0.4 to 1.2 mm radius were 0.43 to 0.98, evenly spread."""

OUTLIERS = 0.03
"""Share of points whose coherence may have any value, as that of one beside which something else sounds."""


def mean_coherence(lit: Sequence[Sample], *, sigma: float) -> tuple[float, float] | None:
    """Mean of C over the samples, and its standard deviation if the marker is a point; None where it is not known.

    Parameters
    ----------
    lit
        Samples with the laser on, as they are at the marker's place.
    sigma
        Noise of one quadrature, in the intensity's unit.
    """
    known = [
        (sample.reading.focused_coherence, math.hypot(POINT_SIGMA, NOISE_SIGMA * sigma / sample.reading.intensity))
        for sample in lit
        if sample.reading.focused_coherence is not None
    ]
    if not known:
        return None
    coherence, each_sigma = np.array(known).T
    weight = each_sigma**-2
    # The samples of one point share its own deviation.
    return float(weight @ coherence / weight.sum()), math.hypot(POINT_SIGMA, 1 / math.sqrt(float(weight.sum())))


def asymmetry_probability(coherence: tuple[float, float] | None) -> float:
    """Return u of (10) from the mean of C and its standard deviation (`mean_coherence`)."""
    if coherence is None:
        return PRIOR
    mean, sigma = coherence
    away = (mean - POINT_COHERENCE) / sigma
    of_point = OUTLIERS + (1 - OUTLIERS) * math.exp(-(away**2) / 2) / (sigma * math.sqrt(2 * math.pi))
    low, high = SPOT_COHERENCES
    of_spot = OUTLIERS + ((1 - OUTLIERS) / (high - low) if mean >= low else 0.0)
    return PRIOR * of_spot / (PRIOR * of_spot + (1 - PRIOR) * of_point)


def shift_scale_deg(coherence: tuple[float, float] | None, *, depth_m: float | None) -> float:
    """Scale a/ρ of the shift of a spot's curve, in degrees.

    Parameters
    ----------
    coherence
        From `mean_coherence`.
    depth_m
        Distance of the marker from the array's face in metres; None if unknown.
    """
    mean = USUAL_COHERENCE if coherence is None else coherence[0]
    radius_m = USUAL_RADIUS_M if depth_m is None else FACE_RADIUS_M + depth_m
    return math.degrees((SHIFT_M + WIDE_SHIFT_M * (1 - mean)) / radius_m)


def shifted_density(
    angle_deg: Float64[np.ndarray, " centres"],
    share: Float64[np.ndarray, " centres"],
    markers_deg: Float64[np.ndarray, " angles"],
    *,
    probability: float,
    scale_deg: float,
) -> Float64[np.ndarray, " angles"]:
    """Return the density of the marker's angle, (10), from the probabilities of the centre of its curve.

    Parameters
    ----------
    angle_deg, share
        Centres of the curve in degrees, evenly spaced, and the probability of each.
    markers_deg
        Angles of the marker at which the density is wanted, in degrees.
    probability
        u: probability that the marker is a spot.
    scale_deg
        Scale of the shift if it is, in degrees.
    """
    step_deg = float(angle_deg[1] - angle_deg[0])
    # The convolution of (10) is a sum over the grid of centres, a few hundred by some dozens.
    same = np.interp(markers_deg, angle_deg, share / step_deg, left=0.0, right=0.0)
    square = 1 + ((markers_deg[:, None] - angle_deg) / scale_deg) ** 2 / 4
    # Student's density with four degrees of freedom is 3/8·square^(−5/2).
    shifted = 0.375 * square**-2.5 @ share / scale_deg
    return np.asarray((1 - probability) * same + probability * shifted)
