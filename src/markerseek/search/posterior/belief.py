"""What a search believes of the marker's angle, for a picture of it: probabilities, and the gain of each angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Interval
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.next_angle import expected_sigmas_deg
from markerseek.search.posterior.shapes import Shapes

BINS = 700
"""Equal parts of the range over which the probabilities are stated: a tenth of a degree of 70."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """Candidates for the next angle."""

    angles_deg: Float64[np.ndarray, " candidates"]
    """The candidates, rising."""
    sigma_deg: Float64[np.ndarray, " candidates"]
    """Standard deviation of the marker's angle that a sample at each is expected to leave, in degrees (11)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Belief:
    """Posterior of the loudest source's angle."""

    angles_deg: Float64[np.ndarray, " parts"]
    probability: Float64[np.ndarray, " parts"]
    """``angles_deg`` and ``probability``: middles of equal parts of the range in degrees, and the probability of each;
    what is missing to 1 lies beyond the range."""
    mean_deg: float
    sigma_deg: float
    interval95_deg: Interval
    """Interval that holds the angle with 95 % probability."""
    choice: Choice | None
    """Candidates for the next angle; None before anything is detected."""


def belief_of(
    posterior: AnglePosterior,
    shapes: Shapes,
    *,
    limits: Interval,
    floor: float,
    detected: bool,
) -> Belief:
    """Return a posterior as a belief.

    ``floor``: intensity that noise usually reaches by itself, over σ. ``detected``: whether anything is detected yet.
    """
    choice = None
    if detected:
        candidates, sigma_deg = expected_sigmas_deg(posterior, shapes, limits=limits, floor=floor)
        choice = Choice(angles_deg=candidates, sigma_deg=sigma_deg)
    ends_deg = np.linspace(limits.low_deg, limits.high_deg, BINS + 1)
    return Belief(
        angles_deg=(ends_deg[1:] + ends_deg[:-1]) / 2,
        probability=np.diff(posterior.cumulative(ends_deg)),
        mean_deg=posterior.mean_deg,
        sigma_deg=posterior.sigma_deg,
        interval95_deg=Interval(low_deg=posterior.quantile_deg(0.025), high_deg=posterior.quantile_deg(0.975)),
        choice=choice,
    )
