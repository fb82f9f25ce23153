"""The next angle: planned, then where the marker is likeliest to be heard, then where a sample tells most of it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from markerseek.core import Interval
from markerseek.core.shapes import Float64
from markerseek.search.posterior._variance import expected_variance
from markerseek.search.posterior.belief import Belief
from markerseek.search.posterior.even import LENGTH, LOG_LEVELS, OWN, STRAYS
from markerseek.search.posterior.shapes import STEP_DEG, Shapes

FIRST_ANGLES = 3
"""Planned angles, evenly spread over the range."""

PLANNED_ANGLES = 8
"""Planned angles in all, where the noise is known: gaps are halved until they are about as wide as a usual curve."""

AUDIBLE_ANGLES = 71
"""Angles, evenly spread over the range, at which a marker may be heard next."""

LEAST_APART_DEG = 0.4
"""Least distance of such an angle from those heard, in degrees."""

AUDIBLE_TRAVEL_DEG = 300.0
"""Travel that must double the probability of hearing the marker to be worth it, in degrees."""

TRAVEL_DEG = 150.0
"""Travel that must halve the remaining uncertainty to be worth it, roughly, in degrees."""

_OWN = sum(error * share for error, share in OWN)


def planned_deg(heard_deg: Sequence[float], *, limits: Interval, falling: bool) -> float:
    """Return the next angle of a search that has heard nothing yet, in degrees.

    First `FIRST_ANGLES` in the middles of equal parts of the range, then the middle of the largest gap; a
    gap at an end of the range counts twice and is closed by the end itself.

    Parameters
    ----------
    heard_deg
        Angles reached so far, in degrees.
    limits
        Range of the search.
    falling
        Whether to begin at the high end.
    """
    count = len(heard_deg)
    if count < FIRST_ANGLES:
        share = (count + 0.5) / FIRST_ANGLES
        return limits.low_deg + limits.width_deg * (1 - share if falling else share)
    inside = sorted(min(max(angle_deg, limits.low_deg), limits.high_deg) for angle_deg in heard_deg)
    gaps = [(high - low, (low + high) / 2) for low, high in pairwise(inside)]
    low_gap, high_gap = inside[0] - limits.low_deg, limits.high_deg - inside[-1]
    gaps += [(2 * low_gap, limits.low_deg), (2 * high_gap, limits.high_deg)]
    return max(gaps, key=lambda gap: gap[0])[1]


def most_audible_deg(
    belief: Belief, shapes: Shapes, heard_deg: Sequence[float], *, limits: Interval, level: float
) -> float:
    """Return the angle at which the marker is likeliest to exceed the noise, travel weighed in, in degrees.

    What was heard so far was all below that level, but not all alike: a wide gap draws the search, and so does a place
    where the largest of the noise was larger than usual.

    Parameters
    ----------
    belief
        The posterior, with many markers drawn.
    shapes
        Family of curves.
    heard_deg
        Angles reached so far, the last one last, in degrees.
    limits
        Range of the search.
    level
        Intensity that noise does not reach, over σ.
    """
    candidates = np.linspace(limits.low_deg, limits.high_deg, AUDIBLE_ANGLES)
    apart = np.abs(candidates[:, None] - np.array(heard_deg)).min(axis=1)
    candidates = candidates[apart >= min(LEAST_APART_DEG, apart.max())]
    away = np.abs(candidates[:, None] - belief.theta_deg) / STEP_DEG
    place = np.minimum(np.rint(away).astype(np.int64), shapes.log_curve.shape[1] - 1)
    height = np.exp(np.minimum(belief.log_snr + shapes.log_curve[belief.member, place], 50.0))
    heard = ndtr(height - level).mean(axis=1)
    travel = np.abs(candidates - heard_deg[-1])
    return float(candidates[np.argmax(heard / (1 + travel / AUDIBLE_TRAVEL_DEG))])


def most_telling_deg(
    belief: Belief, shapes: Shapes, heard_deg: Sequence[float], *, limits: Interval, floor: float
) -> float:
    """Return the angle whose sample is expected to leave the smallest standard deviation, travel weighed in.

    The expectation is over markers drawn from the posterior: each in turn is taken as the truth, and the others keep
    the weight that the sample would leave them, exp(−d²/2) for a difference of d standard deviations of the two.

    Parameters
    ----------
    belief
        The posterior.
    shapes
        Family of curves.
    heard_deg
        Angles reached so far, the last one last, in degrees.
    limits
        Range of the search.
    floor
        Intensity that noise reaches by itself, over σ.
    """
    candidates = _candidates(belief, heard_deg, limits=limits)
    variance = np.empty(candidates.size)
    expected_variance(
        candidates,
        belief.theta_deg,
        belief.member,
        shapes.log_curve,
        belief.log_snr,
        STEP_DEG,
        floor,
        belief.loud_deg,
        belief.loud_log_snr,
        LENGTH * shapes.fwhm_deg,
        LOG_LEVELS,
        STRAYS,
        _OWN,
        variance,
    )
    travel = np.abs(candidates - heard_deg[-1])
    return float(candidates[np.argmin(np.sqrt(variance + 1e-6) * (1 + travel / TRAVEL_DEG))])


def _candidates(belief: Belief, heard_deg: Sequence[float], *, limits: Interval) -> Float64[np.ndarray, " candidates"]:
    """Angles about the middle of the posterior, and over all of it; none that was heard, unless all were."""
    near = belief.mean_deg + belief.fwhm_deg * np.linspace(-1.6, 1.6, 19)
    if belief.loud_deg.size:
        # The other flank, where the curve was heard on one: what is unknown of it is the same there.
        wide = 2 * belief.mean_deg - belief.loud_deg
    else:
        low_deg, high_deg = float(belief.theta_deg.min()), float(belief.theta_deg.max())
        wide = np.linspace(low_deg - belief.fwhm_deg, high_deg + belief.fwhm_deg, 18)
    angles = np.concatenate([near, wide, [limits.low_deg, limits.high_deg]])
    angles = np.unique(angles[(angles >= limits.low_deg) & (angles <= limits.high_deg)])
    apart = np.abs(angles[:, None] - np.array(heard_deg)).min(axis=1)
    least = min(max(0.25, 0.06 * belief.fwhm_deg), limits.width_deg / 100)
    fresh = angles[apart >= least]
    return fresh if fresh.size else angles[[int(np.argmax(apart))]]
