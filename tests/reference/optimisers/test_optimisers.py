"""Optimisers of other packages as policies: same angles as by themselves, and no unfounded claims."""

from __future__ import annotations

import pytest
from scipy.optimize import minimize_scalar

from benchmarks.optimisers import BoundedMinimiser, ScikitOptimize, checked_minimiser
from markerseek.contract import PolicyContract
from markerseek.core import Found, Interval, Policy, Reading, Sample, Unsure


def curve(angle_deg: float) -> float:
    return 3.0 / (1 + ((angle_deg - 7.3) / 4) ** 2)


def sample(angle_deg: float, intensity: float | None = None) -> Sample:
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=curve(angle_deg) if intensity is None else intensity))


def search(policy: Policy) -> list[float]:
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(sample(angle_deg))
    return asked


@pytest.mark.parametrize("acquisitions", [1, 2, 7, 40])
def test_the_bounded_minimiser_asks_what_scipy_evaluates(acquisitions: int) -> None:
    evaluated: list[float] = []

    def turned_over(angle_deg: float) -> float:
        evaluated.append(float(angle_deg))
        return -curve(float(angle_deg))

    result = minimize_scalar(turned_over, bounds=(-35, 35), method="bounded", options={"xatol": 1e-3})
    policy = BoundedMinimiser(acquisitions=acquisitions)
    asked = search(policy)
    assert asked == pytest.approx(evaluated[:acquisitions], rel=1e-12)
    assert len(evaluated) < 40, "the minimiser converges, so that the last case ends before its budget"
    if acquisitions == 40:
        assert policy.estimate().mean_deg == pytest.approx(result.x, abs=1e-3)
        assert policy.estimate().mean_deg == pytest.approx(7.3, abs=0.01)


def test_scikit_optimize_asks_what_it_asks_by_itself() -> None:
    skopt = pytest.importorskip("skopt")
    alone = skopt.Optimizer(
        [(-35.0, 35.0)], base_estimator="GP", n_initial_points=4, initial_point_generator="lhs", random_state=1
    )
    asked = []
    for _ in range(6):
        angle_deg = float(alone.ask()[0])
        asked.append(angle_deg)
        # it gets intensities relative to the first one
        alone.tell([angle_deg], -curve(angle_deg) / curve(asked[0]))
    assert search(ScikitOptimize(acquisitions=6)) == asked


def test_checked_an_optimiser_claims_only_what_it_knows() -> None:
    policy = checked_minimiser(acquisitions=12)
    for intensity in (0.010, 0.012, 0.011):
        policy.tell(Sample(angle_deg=0.0, reading=Reading(intensity=intensity), dark=True))
    search(policy)
    assert isinstance(policy.estimate(), Found | Unsure)
    wide = checked_minimiser(acquisitions=4)
    for intensity in (0.010, 0.012, 0.011):
        wide.tell(Sample(angle_deg=0.0, reading=Reading(intensity=intensity), dark=True))
    search(wide)
    assert isinstance(wide.estimate(), Unsure)


class TestBoundedMinimiser(PolicyContract):
    def make(self, limits: Interval) -> Policy:
        return BoundedMinimiser(limits=limits, acquisitions=12)
