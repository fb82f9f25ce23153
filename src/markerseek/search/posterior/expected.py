"""A prior over the marker's angle: where the search looks first, and what the samples say of the prior.

The prior q is wrong with the probability ε, and the marker is then anywhere in the range of width R:

    π(θ) = (1 − ε)·q(θ) + ε/R.                                                                                  (15)

π is not multiplied into the answer. It weighs what may still hide (13): that the marker hides at θ, and the source seen
at θ₁ is another one, is as probable as π(θ)/π(θ₁) says. That the prior is wrong has the probability ε/(R·π(θ₁)), where
π(θ₁) is the mean over the posterior of the samples, and also of a search that has detected nothing yet.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import AnglePrior, Float64, Interval, MarkerCurve
from markerseek.search.posterior.candidates import RIVAL_DB, Candidate
from markerseek.search.posterior.inference import AnglePosterior

WRONG = 0.05
"""Probability ε that a prior is wrong, before anything is measured."""

MOST_WRONG = 0.5
"""Probability that it is wrong from which it is given up."""

SURVEY_ANGLES = 71
"""Angles at which a hidden source is assumed, evenly spread over the range; every second may be the next sample's."""


def survey_angles_deg(limits: Interval) -> Float64[np.ndarray, " angles"]:
    """Angles of the range at which a hidden source is assumed, in degrees."""
    return np.linspace(limits.low_deg, limits.high_deg, SURVEY_ANGLES)


class ExpectedAngle:
    """A prior over the angle on the range of a search.

    Raises `ConfigError` if the prior lies outside of the range.
    """

    def __init__(self, prior: AnglePrior, *, limits: Interval) -> None:
        self.window = prior.interval(limits)
        angles_deg = survey_angles_deg(limits)
        # Parts of the range about these angles: the first and the last are half as wide.
        self._ends_deg = np.array([angles_deg[0], *((angles_deg[1:] + angles_deg[:-1]) / 2), angles_deg[-1]])
        mass = np.diff([prior.below(each) for each in self._ends_deg.tolist()])
        uniform = np.diff(self._ends_deg) / limits.width_deg
        self._density = (1 - WRONG) * mass / mass.sum() / uniform + WRONG
        """R·π of each part."""

    def weights(self, posterior: AnglePosterior) -> Float64[np.ndarray, " angles"]:
        """π(θ)/π(θ₁) at each of the angles of the survey, for a source with this posterior."""
        return np.asarray(self._density / self._at(posterior))

    def wrong_probability(self, posterior: AnglePosterior) -> float:
        """Probability that the prior is wrong, where the posterior of the samples is that of the marker."""
        return WRONG / self._at(posterior)

    def is_contradicted(self, source: Candidate, *, former: MarkerCurve | None) -> bool:
        """Whether the prior is more probably wrong than right, where this source is the strongest.

        ``former``: curve of a former marker, which a source that is much weaker does not resemble.
        """
        if former is not None and source.missing is None:
            peak = source.posterior.sigma * math.exp(source.log_snr)
            if peak < former.peak * 10 ** (-RIVAL_DB / 20):
                return True
        return self.wrong_probability(source.posterior) > MOST_WRONG

    def _at(self, posterior: AnglePosterior) -> float:
        share = np.diff(posterior.cumulative(self._ends_deg))
        # A marker beyond an end of the range contradicts a prior within it.
        return float(share @ self._density + (1 - share.sum()) * WRONG)
