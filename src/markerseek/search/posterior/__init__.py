"""The posterior search: prior of the curve, likelihood of the readings, posterior of the angle, next angle."""

from markerseek.search.posterior.inference import energy_spread
from markerseek.search.posterior.likelihood import with_light
from markerseek.search.posterior.next_angle import Belief
from markerseek.search.posterior.policy import CUES, TARGET_SIGMA_DEG, Posterior
from markerseek.search.posterior.survey import USUAL_OTHERS
from markerseek.search.posterior.sweeping import SWEPT_SIGMA_DEG, SweepPosterior, centre_by, way_of

__all__ = [
    "CUES",
    "SWEPT_SIGMA_DEG",
    "TARGET_SIGMA_DEG",
    "USUAL_OTHERS",
    "Belief",
    "Posterior",
    "SweepPosterior",
    "centre_by",
    "energy_spread",
    "way_of",
    "with_light",
]
