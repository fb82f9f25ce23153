"""Every method, in both forms, keeps the contract of a policy."""

from __future__ import annotations

import pytest

from markerseek.contract import PolicyContract
from markerseek.core import Interval, Policy, SearchPlan
from markerseek.search import GOLDEN, METHODS, BracketSearch, build
from markerseek.search.posterior import Posterior

SMALL = Interval(low_deg=3.0, high_deg=4.5)


class TestSmallRange(PolicyContract):
    limits = SMALL

    def make(self, limits: Interval) -> Policy:
        return build(SearchPlan(method="golden-section-reuse", acquisitions=200), limits=limits)


FORMS = [
    (method.name, as_published) for method in METHODS if method.name != "posterior" for as_published in (True, False)
]


@pytest.mark.parametrize(("name", "as_published"), FORMS)
class TestMethods(PolicyContract):
    @pytest.fixture(autouse=True)
    def _form(self, name: str, as_published: bool) -> None:
        self.form = (name, as_published)

    def make(self, limits: Interval) -> Policy:
        name, as_published = self.form
        acquisitions = 29 if name == "exhaustive" else None
        return build(SearchPlan(method=name, acquisitions=acquisitions, as_published=as_published), limits=limits)


class TestPosterior(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits)


class TestPosteriorWithEveryAcquisition(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=6, target_sigma_deg=0.0, start_deg=limits.high_deg)


class TestPosteriorInASmallRange(PolicyContract):
    limits = SMALL

    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=6)


@pytest.mark.parametrize("cue", ["intensity", "arrival"])
class TestPosteriorByOneCue(PolicyContract):
    @pytest.fixture(autouse=True)
    def _cue(self, cue: str) -> None:
        self.cue = cue

    def make(self, limits: Interval) -> Policy:
        return Posterior(limits=limits, acquisitions=3, cues=[self.cue])


class _Endless(BracketSearch):
    """A policy that never ends."""

    def ask(self) -> float | None:
        return 0.0


class _EndlessContract(PolicyContract):
    most = 50

    def make(self, limits: Interval) -> Policy:
        return _Endless(ratio=GOLDEN, limits=limits, acquisitions=20)


@pytest.mark.parametrize("name", ["test_asks_inside_the_range", "test_refuses_samples_after_the_end"])
def test_the_contract_ends_on_a_policy_that_never_does(name: str) -> None:
    with pytest.raises(AssertionError, match="the search has not ended after 50 acquisitions"):
        getattr(_EndlessContract(), name)()
