"""The search by a posterior over the marker's angle: what is heard, what it says, where to listen next."""

from markerseek.search.posterior.policy import CUES, TARGET_SIGMA_DEG, Posterior

__all__ = ["CUES", "TARGET_SIGMA_DEG", "Posterior"]
