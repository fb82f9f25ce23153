"""Optimisers of other packages keep the contract of a policy; BoTorch's where it is installed."""

from __future__ import annotations

import pytest

from benchmarks.optimisers import BoTorch, BoundedMinimiser, ScikitOptimize, bounded_minimiser
from markerseek.core import Interval, Policy
from markerseek.testing import PolicyContract, policies


class TestBoundedMinimiser(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return bounded_minimiser(limits=limits, acquisitions=12)


class TestBoundedMinimiserInASmallRange(PolicyContract):
    limits = Interval(low_deg=3.0, high_deg=4.5)

    def make(self, limits: Interval) -> Policy:
        return BoundedMinimiser(limits=limits, acquisitions=100)


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
        # its model is fitted once it has received as many samples as its first design has
        policy = ScikitOptimize(limits=limits, acquisitions=3)
        policy._optimizer._n_initial_points = 2
        return policy


class TestBoTorch(FewCurves):
    @pytest.fixture(autouse=True)
    def _installed(self) -> None:
        pytest.importorskip("botorch", exc_type=ImportError)

    def make(self, limits: Interval) -> Policy:
        return BoTorch(limits=limits, acquisitions=5)
