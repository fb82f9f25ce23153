"""The next angle while nothing is detected, against explicitly computed probabilities."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from markerseek.core import ByHand, Interval
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.next_angle import (
    DETECTION_TRAVEL_DEG,
    MIN_APART_DEG,
    PLAN,
    PLAN_BY_HAND,
    effort_deg,
    most_detectable_deg,
    planned_deg,
    step_near_deg,
)
from markerseek.search.posterior.shapes import STEP_DEG, family
from tests.sizes import examples

SHAPES = family()
LIMITS = Interval(low_deg=-35.0, high_deg=35.0)
LEVEL = 6.3


def posterior(theta_deg, log_snr, member, **known):
    """A posterior of which only the drawn markers count, and what else is known."""
    nothing = np.zeros(0)
    ends_deg = np.array([0.0, 1.0])
    halves = np.array([0.5, 0.5])
    usual = {
        "angle_deg": ends_deg,
        "probability": halves,
        "coarse_deg": ends_deg,
        "coarse_probability": halves,
        "sigma": 1.0,
        "strong_deg": nothing,
        "strong_log_snr": nothing,
        "strong_samples": np.zeros(0, np.int64),
        "energy_gain": None,
        "sample_error": 0.02,
        "fwhm_deg": 5.0,
        "centre_sigma_deg": 1.0,
    }
    return AnglePosterior(theta_deg=theta_deg, log_snr=log_snr, member=member, **(usual | known))


def test_the_angle_has_the_largest_probability_of_detection():
    """Each marker's height over the noise by NumPy's interpolation, its probability by SciPy's normal distribution."""
    rng = np.random.default_rng(8)
    theta_deg = rng.uniform(-38, 38, 90)
    log_snr = rng.normal(2.5, 1.0, 90)
    member = rng.choice([5, 20, 40], 90)
    measured_deg = [-23.3, 0.0, 23.3]
    found = most_detectable_deg(posterior(theta_deg, log_snr, member), measured_deg, limits=LIMITS, level=LEVEL)
    steps = np.arange(SHAPES.log_curve.shape[1]) * STEP_DEG
    best = 0.0
    largest = 0.0
    for angle_deg in np.arange(-35.0, 35.1, 1.0):
        if min(abs(angle_deg - other) for other in measured_deg) < MIN_APART_DEG:
            continue
        heights = [
            np.exp(amplitude + np.interp(abs(angle_deg - t), steps, SHAPES.log_curve[kind]))
            for t, amplitude, kind in zip(theta_deg, log_snr, member, strict=True)
        ]
        worth = norm.cdf(heights, loc=LEVEL).mean() / (1 + abs(angle_deg - measured_deg[-1]) / DETECTION_TRAVEL_DEG)
        if worth > largest:
            best = angle_deg
            largest = worth
    assert found == pytest.approx(best)


@settings(max_examples=examples(50), deadline=None)
@given(
    measured_deg=st.lists(st.floats(-35, 35), min_size=1, max_size=30),
    middle_deg=st.floats(-37, 37),
    snr=st.floats(-2, 300),
)
def test_it_lies_in_the_range_and_apart_from_the_measured_angles(measured_deg, middle_deg, snr):
    drawn = posterior(np.full(7, middle_deg), np.full(7, snr), np.full(7, 20))
    angle_deg = most_detectable_deg(drawn, measured_deg, limits=LIMITS, level=LEVEL)
    assert LIMITS.low_deg <= angle_deg <= LIMITS.high_deg
    assert min(abs(angle_deg - other) for other in measured_deg) >= MIN_APART_DEG


def test_in_a_range_measured_everywhere_it_is_in_the_largest_gap():
    measured_deg = [*np.arange(-1.0, 0.8, 0.1).tolist(), 1.0]
    drawn = posterior(np.zeros(3), np.zeros(3), np.full(3, 20))
    narrow = Interval(low_deg=-1.0, high_deg=1.0)
    angle_deg = most_detectable_deg(drawn, measured_deg, limits=narrow, level=LEVEL)
    assert 0.8 < angle_deg < 1.0


def planned(*, descending):
    measured_deg = []
    for _ in PLAN:
        measured_deg.append(planned_deg(measured_deg, limits=LIMITS, descending=descending))
    return np.array(measured_deg)


def test_eight_planned_angles_are_the_middles_of_equal_parts():
    """They detect markers as early as any order of them does, to 3 %: dynamic programming tries all orders."""
    up = planned(descending=False)
    np.testing.assert_allclose(np.sort(up), np.arange(-30.625, 31, 8.75))
    np.testing.assert_allclose(planned(descending=True), -up)
    rng = np.random.default_rng(1)
    markers_deg = rng.uniform(-35, 35, 4000)
    fwhm_deg = np.exp(rng.uniform(np.log(3), np.log(17), 4000))
    height = 10 ** (rng.choice([20, 30, 40], 4000) / 20)
    away = 2 * np.abs(np.sort(up)[:, None] - markers_deg) / fwhm_deg
    shown = height * (1 + 3 * away**2.4) ** -0.5 > LEVEL
    code = (shown * 2 ** np.arange(8)[:, None]).sum(axis=0)
    missed = np.array([(code & mask == 0).mean() for mask in range(256)])
    # Mean number of acquisitions that an order needs from those of a mask on.
    needed = np.zeros(256)
    for mask in range(254, -1, -1):
        needed[mask] = missed[mask] + min(needed[mask | 1 << k] for k in range(8) if not mask >> k & 1)
    masks = np.concatenate([[0], np.cumsum(2 ** np.array(PLAN[:-1]))])
    assert missed[masks].sum() < 1.03 * needed[0]


def test_a_hand_turns_back_once_while_nothing_is_seen():
    by_hand = [planned_deg([0.0] * count, limits=LIMITS, descending=False, plan=PLAN_BY_HAND) for count in range(8)]
    # The same angles as with a motor, and the first three in the same order.
    np.testing.assert_allclose(np.sort(by_hand), np.sort(planned(descending=False)))
    np.testing.assert_allclose(by_hand[:3], planned(descending=False)[:3])
    turns = np.diff(by_hand)
    assert (turns[1:] * turns[:-1] < 0).sum() == 1


def test_turning_back_is_an_effort_of_a_hand():
    candidates = np.array([-10.0, 5.0, 30.0])
    np.testing.assert_allclose(effort_deg(candidates, [0.0, 10.0], None), [20.0, 5.0, 20.0])
    np.testing.assert_allclose(effort_deg(candidates, [0.0, 10.0], ByHand(reversal_deg=150.0)), [170.0, 155.0, 20.0])
    np.testing.assert_allclose(effort_deg(candidates, [10.0], ByHand()), [20.0, 5.0, 20.0])


@given(angle_deg=st.floats(-35, 35), step_deg=st.sampled_from([0.1, 0.5, 1.0, 5.0]))
def test_a_hand_is_asked_for_the_nearest_step_in_the_range(angle_deg, step_deg):
    near_deg = step_near_deg(angle_deg, limits=LIMITS, step_deg=step_deg)
    assert near_deg in LIMITS
    assert abs(near_deg - angle_deg) <= step_deg / 2 + 1e-9
    assert near_deg / step_deg == pytest.approx(round(near_deg / step_deg))


@given(high=st.integers(-350, 350), step=st.integers(1, 7))
def test_the_nearest_step_is_in_the_range_where_that_ends_with_a_step(high, step):
    """-317 · 0.1 is -31.700000000000003, which the guard of a range from -31.7 refuses."""
    end_deg = high * step / 10
    for limits in (Interval(low_deg=end_deg, high_deg=end_deg + 20), Interval(low_deg=end_deg - 20, high_deg=end_deg)):
        assert step_near_deg(end_deg, limits=limits, step_deg=step / 10) in limits


def test_where_the_range_holds_no_step_the_angle_itself_is_asked_for():
    assert step_near_deg(0.4, limits=Interval(low_deg=0.2, high_deg=0.7), step_deg=1.0) == 0.4
