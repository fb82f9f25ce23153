"""The posterior policy keeps the contract of a policy, with every choice of cues."""

from __future__ import annotations

import pytest

from markerseek.core import Interval, Policy
from markerseek.search.posterior import Posterior
from markerseek.testing import PolicyContract


class TestPosterior(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits)


class TestEveryAcquisition(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=6, target_sigma_deg=0.0, start_deg=limits.high_deg)


class TestSmallRange(PolicyContract):
    limits = Interval(low_deg=3.0, high_deg=4.5)

    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=6)


@pytest.mark.parametrize("cue", ["intensity", "arrival"])
class TestOneCue(PolicyContract):
    @pytest.fixture(autouse=True)
    def _cue(self, cue: str) -> None:
        self.cue = cue

    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=3, cues=[self.cue])
