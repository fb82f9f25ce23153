"""How far the centre of the curve of an asymmetric marker lies from the marker.

The curve of a point is symmetric. That of a stained spot is not: its absorbers interfere, and the centre of the curve
lies some tenths of a millimetre beside the centroid of the spot; tissue on the way shifts it as well. All samples of
one curve share its centre, so that more of them do not show the shift: it is a nuisance parameter, and the posterior is
widened by it,

    p(θ) = (1 − u)·q(θ) + u·∫ q(θ') t₄((θ − θ')·ρ/a) dθ'·ρ/a,                                                (10)

with q the posterior of the centre, u the probability that the marker is such a spot, ρ its distance from the axis, and
t₄ Student's density with four degrees of freedom, because most spots are shifted by little and some by much (on 285
simulated spots it was more likely than a normal density by exp(18)).

All sound of a point is in phase over the array at its best focus (`Reading.focused_coherence`, C), whatever its pulse
and the speed of sound; that of a spot wider than the array resolves is not. Bayes' rule gives u from the mean of C over
the samples: that of a point is 1 but for a small deviation, that of a spot may have any value. A long wave resolves
little: then a spot may look like a point, and its curve, for the same reason, is wide. Where the width w of the curve,
as a length at the marker, is large, more of the spots are therefore expected at C = 1. Two sources that sound at once
are taken for a spot: the interval is then too wide rather than too narrow.

The less of the sound is in phase, the more C differs from angle to angle (s, its standard deviation: the absorbers
interfere differently at each), and the wider the curve, the larger is the shift:

    a = (a₀ + a₁·(1 − C) + a₂·s)·√(w/5 mm).                                                                  (10c)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from markerseek.core import Float64, Sample

SPOT_PRIOR = 0.3
"""Prior probability of an asymmetric marker."""

SHIFT_M = 0.105e-3
INCOHERENT_SHIFT_M = 0.05e-3
SCATTER_SHIFT_M = 1.5e-3
"""a₀, a₁ and a₂ in metres: the most likely values in 310 searches for simulated spots in four tissues, enlarged until
the intervals cover."""

USUAL_WIDTH_M = 5e-3
"""Width of a curve, as a length at the marker, to which `SHIFT_M` refers."""

USUAL_SHIFT_M = 0.2e-3
"""a in metres if the frames do not tell C and s: the value of all 1,039 spots, whatever their width."""

POINT_SIGMA = 0.005
NOISE_SIGMA = 0.5
"""Root mean square deviation of a point's C from 1, from point to point, and by noise times the SNR: of 260 simulated
points at 30 and 40 dB with all unknowns drawn."""

UNRESOLVED_WIDTH_M = 9e-3
UNRESOLVED_POWER = 6
"""Width w₀ of the curve at which every second spot looks like a point, and the power n with which their share grows,
1/(1 + (w₀/w)ⁿ): of the 1,039 spots 1 % had C > 0.985 where w < 5 mm, 44 % where it was 12 to 15 mm."""

UNRESOLVED_INCOHERENCE = 0.05
"""Mean of 1 − C of the spots that look like points."""

UNLIKE_POINTS = 0.03
"""Share of points whose coherence may have any value, for example because something else sounds beside them."""


class MeanCoherence(NamedTuple):
    """The coherence C at the best focus, over the samples of one source."""

    mean: float
    sigma: float
    """Standard deviation of the mean if the source is a point."""
    scatter: float
    """Its standard deviation from sample to sample."""


def mean_coherence(lit: Sequence[Sample], *, sigma: float) -> MeanCoherence | None:
    """Return the mean and scatter of C over the samples; None if not known.

    ``lit``: samples with the laser on, as they are at the marker's place. ``sigma``: noise of one quadrature, in the
    intensity's unit.
    """
    known = [
        (sample.reading.focused_coherence, math.hypot(POINT_SIGMA, NOISE_SIGMA * sigma / sample.reading.intensity))
        for sample in lit
        if sample.reading.focused_coherence is not None and sample.reading.intensity > 0
    ]
    if not known:
        return None
    coherence, each_sigma = np.array(known).T
    precision = each_sigma**-2
    total = float(precision.sum())
    weight = precision / total
    mean = float(weight @ coherence)
    return MeanCoherence(
        mean=mean,
        # The samples of one point share its own deviation.
        sigma=math.hypot(POINT_SIGMA, 1 / math.sqrt(total)),
        scatter=math.sqrt(float(weight @ (coherence - mean) ** 2)),
    )


def asymmetry_probability(coherence: MeanCoherence | None, *, width_m: float) -> float:
    """Return u of (10).

    ``width_m``: full width of the curve at half maximum, as a length at the marker.
    """
    if coherence is None:
        return SPOT_PRIOR
    incoherence = 1 - coherence.mean
    sigma = coherence.sigma
    # A half-normal distribution.
    of_point = UNLIKE_POINTS + (1 - UNLIKE_POINTS) * math.exp(-((incoherence / sigma) ** 2) / 2) / (
        sigma * math.sqrt(math.pi / 2)
    )
    unresolved = 1 / (1 + (UNRESOLVED_WIDTH_M / width_m) ** UNRESOLVED_POWER)
    # A resolved spot may have any coherence from 0 to 1, each as probably: those of patches of 5 mm were 0.3 to 0.8.
    resolved = 1.0
    like_point = math.exp(-incoherence / UNRESOLVED_INCOHERENCE) / UNRESOLVED_INCOHERENCE
    of_spot = UNLIKE_POINTS + (1 - UNLIKE_POINTS) * ((1 - unresolved) * resolved + unresolved * like_point)
    return SPOT_PRIOR * of_spot / (SPOT_PRIOR * of_spot + (1 - SPOT_PRIOR) * of_point)


def shift_scale_m(coherence: MeanCoherence | None, *, width_m: float) -> float:
    """Return the scale a of the shift of a spot's curve, (10c), in metres."""
    if coherence is None:
        return USUAL_SHIFT_M
    narrow_m = SHIFT_M + INCOHERENT_SHIFT_M * (1 - coherence.mean) + SCATTER_SHIFT_M * coherence.scatter
    return narrow_m * math.sqrt(width_m / USUAL_WIDTH_M)


def shifted_density(
    angle_deg: Float64[np.ndarray, " centres"],
    share: Float64[np.ndarray, " centres"],
    markers_deg: Float64[np.ndarray, " angles"],
    *,
    probability: float,
    scale_deg: float,
) -> Float64[np.ndarray, " angles"]:
    """Return the density of the marker's angle, (10), from the probabilities of the centre of its curve.

    ``angle_deg``, ``share``: centres of the curve in degrees, evenly spaced, and the probability of each.
    ``markers_deg``: angles of the marker at which the density is wanted. ``probability``: u: probability that the
    marker is a spot. ``scale_deg``: scale of the shift if it is.
    """
    step_deg = float(angle_deg[1] - angle_deg[0])
    # The convolution of (10) is a sum over the grid of centres, a few hundred by some dozens.
    same = np.interp(markers_deg, angle_deg, share / step_deg, left=0.0, right=0.0)
    square = 1 + ((markers_deg[:, None] - angle_deg) / scale_deg) ** 2 / 4
    # Student's density with four degrees of freedom is 3/8·square^(−5/2).
    shifted = 0.375 * square**-2.5 @ share / scale_deg
    return np.asarray((1 - probability) * same + probability * shifted)
