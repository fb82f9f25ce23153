"""The posterior search: prior of the curve, likelihood of the readings, posterior of the angle, next angle."""

from markerseek.search.posterior.belief import Belief, Choice
from markerseek.search.posterior.policy import CUES, TARGET_SIGMA_DEG, Posterior

__all__ = ["CUES", "TARGET_SIGMA_DEG", "Belief", "Choice", "Posterior"]
