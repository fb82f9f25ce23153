"""Optimisers of other packages keep the contract of a policy; BoTorch's where it is installed."""

from __future__ import annotations

import pytest

from markerseek.adapters import build_adapter
from markerseek.core import Interval, Policy
from markerseek.testing import PolicyContract, policies


@pytest.mark.parametrize("as_published", [True, False])
class TestBoundedMinimiser(PolicyContract):
    @pytest.fixture(autouse=True)
    def _form(self, as_published: bool) -> None:
        self.as_published = as_published

    def make(self, limits: Interval) -> Policy:
        return build_adapter("bounded-minimiser", limits=limits, acquisitions=12, as_published=self.as_published)


class TestBoundedMinimiserInASmallRange(PolicyContract):
    limits = Interval(low_deg=3.0, high_deg=4.5)

    def make(self, limits: Interval) -> Policy:
        return build_adapter("bounded-minimiser", limits=limits, acquisitions=100, as_published=True)


class FewCurves(PolicyContract):
    """The contract over fewer curves and stages, for optimisers that take a second to think."""

    @pytest.fixture(autouse=True)
    def _few(self, monkeypatch: pytest.MonkeyPatch) -> None:
        few = ("marker in the middle", "marker to one side", "flat", "huge")
        monkeypatch.setattr(policies, "CURVES", {name: policies.CURVES[name] for name in few})
        monkeypatch.setattr(policies, "MISSED_BY", {"beyond the range": policies.MISSED_BY["beyond the range"]})


class TestScikitOptimize(FewCurves):
    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
        pytest.importorskip("skopt")

    def make(self, limits: Interval) -> Policy:
        from markerseek.adapters import ScikitOptimize

        # its model is fitted once it has received as many samples as its first design has
        policy = ScikitOptimize(limits=limits, acquisitions=3)
        policy._optimizer._n_initial_points = 2
        return policy


class TestBoTorch(FewCurves):
    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
        pytest.importorskip("botorch", exc_type=ImportError)

    def make(self, limits: Interval) -> Policy:
        return build_adapter("botorch", limits=limits, acquisitions=5, as_published=True)
