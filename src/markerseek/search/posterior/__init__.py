"""The search by a posterior over the marker's angle: what is heard, what it says, where to listen next."""

from markerseek.search.posterior.policy import CUES, Posterior

__all__ = ["CUES", "Posterior"]
