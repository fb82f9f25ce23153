"""Ziv and Zakai's bound: for few samples, where the question is still which part of the range the marker lies in.

For a marker that is equally likely anywhere in a range of width W,

    MSE ≥ (1/W)·∫ h·V{ ∫ P(θ, θ+h) dθ } dh,

where P is the least probability of error with which θ and θ + h can be told apart when both are as likely,
Q(d/2) with d² = Σ (μᵢ(θ) − μᵢ(θ+h))²/σ² for normal noise, and V fills the valleys: V f(h) is the largest f at h or
beyond (J. Ziv and M. Zakai, IEEE Trans. Inf. Theory 15, 386 (1969); K. L. Bell et al., ibid. 43, 624 (1997)). Without
information it is the prior's variance W²/12, with much the Cramér–Rao bound. Shape and amplitude are taken as known: a
search that knows less does no better.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import PAPER_RANGE, ConfigError, Interval
from markerseek.core.shapes import Float64
from markerseek.search.bounds.curves import SlopedCurve

_ANGLES = 281
"""Places of the marker over which the inner integral runs."""

_APART = 160
"""Distances h over which the outer one runs, evenly spaced in their logarithm."""


def ziv_zakai_deg(
    curve: SlopedCurve,
    angle_deg: Float64[np.ndarray, " samples"],
    *,
    snr: float,
    limits: Interval = PAPER_RANGE,
) -> float:
    """Return the least root mean square error over markers anywhere in the range, in degrees.

    Parameters
    ----------
    curve
        The markers' curve.
    angle_deg
        Where is listened, whatever is heard, in degrees.
    snr
        Amplitude over σ; 0 is no information.
    limits
        Range in which the marker is equally likely.

    Raises
    ------
    ConfigError
        If ``snr`` is negative or not finite.
    """
    from scipy.special import ndtr

    if not 0 <= snr < math.inf:
        raise ConfigError(f"Ziv–Zakai bound: snr is {snr}, it must be finite and not negative")
    width = limits.width_deg
    apart = np.concatenate([[0.0], np.geomspace(1e-5 * width, width, _APART)])
    inner = np.empty_like(apart)
    for k, h in enumerate(apart.tolist()):
        theta = np.linspace(limits.low_deg, limits.high_deg - h, _ANGLES)
        here = curve.value(angle_deg - theta[:, None])
        there = curve.value(angle_deg - theta[:, None] - h)
        distance = snr * np.sqrt(np.sum((here - there) ** 2, axis=1))
        inner[k] = np.trapezoid(ndtr(-distance / 2), theta)
    filled = np.maximum.accumulate(inner[::-1])[::-1]
    return math.sqrt(float(np.trapezoid(apart * filled, apart)) / width)
