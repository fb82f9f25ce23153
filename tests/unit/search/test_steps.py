"""Sweeps, the weighted average, the parabola, and the statistics of a peak."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import ConfigError, Interval, Sample, SearchError
from markerseek.search import (
    Curve,
    Exhaustive,
    WeightedAverage,
    curve_of,
    equal_steps,
    peak_of,
    peak_passed,
    weighted_average,
)
from markerseek.search.curve import noise_limit_deg
from markerseek.search.manual import ScriptedManual
from markerseek.search.posterior import Posterior
from markerseek.search.steps import average_sigma_deg, fit_top
from tests.unit.core.damaged import damaged

PAPER = Interval(low_deg=-35.0, high_deg=35.0)
intensities = st.lists(st.floats(0, 1e300), min_size=1, max_size=30)


def sample(angle_deg, intensity):
    return Sample(angle_deg=angle_deg, reading=damaged(intensity=intensity))


def curve(angle_deg, intensity):
    return Curve(angle_deg=np.asarray(angle_deg, dtype=float), intensity=np.asarray(intensity, dtype=float))


def run(policy, intensity):
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(sample(angle_deg, float(intensity(angle_deg))))
    return asked


@pytest.mark.parametrize(("acquisitions", "step_deg"), [(2, 70), (8, 10), (15, 5), (29, 2.5), (141, 0.5)])
def test_steps_of_eq_5(acquisitions, step_deg):
    angles = equal_steps(PAPER, acquisitions=acquisitions)
    assert angles.size == acquisitions
    assert (angles[0], angles[-1]) == (-35, 35)
    np.testing.assert_allclose(np.diff(angles), step_deg)


@pytest.mark.parametrize(
    ("start_deg", "first_deg"), [(None, -35), (-35.0, -35), (-1.0, -35), (0.0, -35), (1.0, 35), (90.0, 35)]
)
def test_begins_at_the_nearer_end(start_deg, first_deg):
    asked = run(Exhaustive(acquisitions=8, start_deg=start_deg), lambda _: 1.0)
    assert asked[0] == first_deg
    assert sorted(asked) == pytest.approx(list(range(-35, 36, 10)))


PASSED = {
    "rising": ([1, 2, 3], False),
    "two below": ([1, 10, 1, 1], True),
    "one below": ([1, 10, 1], False),
    "below, then not": ([10, 1, 3], False),
    "at the threshold is not below": ([10, 2, 2], False),
    "peak at the first": ([10, 1, 1], True),
    "the last is the peak": ([1, 1, 10], False),
    "flat": ([1, 1, 1, 1], False),
    "zero": ([0, 0, 0, 0], False),
    "too few": ([10, 1], False),
    "none": ([], False),
}


@pytest.mark.parametrize(("values", "passed"), PASSED.values(), ids=PASSED.keys())
def test_peak_recorded_and_passed(values, passed):
    assert peak_passed(np.array(values, dtype=float)) is passed


def test_early_end_and_full_scan_answer_the_same():
    full = WeightedAverage(acquisitions=29, early_end=False)
    early = WeightedAverage(acquisitions=29)
    counts = [len(run(policy, lambda angle: math.exp(-((angle / 4) ** 2)))) for policy in (full, early)]
    assert counts[0] == 29 > counts[1]
    assert early.estimate().mean_deg == pytest.approx(full.estimate().mean_deg, abs=1e-12)


@pytest.mark.parametrize("level", [0.0, 1.0, 1e-310])
def test_flat_curve_answers_with_the_mean_angle(level):
    policy = WeightedAverage(acquisitions=8)
    run(policy, lambda _: level)
    assert policy.estimate().mean_deg == pytest.approx(0)
    assert policy.estimate().sigma_deg > 1


def test_weights_are_not_shifted_and_weak_samples_left_out():
    angle_deg = np.array([-10.0, 0.0, 10.0, 20.0])
    intensity = np.array([1.9, 10.0, 5.0, 2.0])
    assert float(weighted_average(angle_deg, intensity)) == pytest.approx((5 * 10 + 2 * 20) / 17)


@given(values=intensities)
def test_mirror_symmetry_of_eq_1(values):
    angle_deg = np.linspace(-35, 35, len(values)) if len(values) > 1 else np.array([7.0])
    intensity = np.array(values)
    mean_deg = float(weighted_average(angle_deg, intensity))
    mirrored_deg = float(weighted_average(-angle_deg[::-1], intensity[::-1]))
    assert mirrored_deg == pytest.approx(-mean_deg, abs=1e-9)
    assert angle_deg.min() <= mean_deg <= angle_deg.max()


@given(values=st.lists(st.floats(0, 1e3), min_size=8, max_size=8), order=st.permutations(range(8)))
def test_the_order_of_samples_does_not_matter(values, order):
    pairs = [(-35.0 + 10 * index, value) for index, value in enumerate(values)]
    answers = []
    for policy_type in (WeightedAverage, Exhaustive):
        for arranged in (pairs, [pairs[index] for index in order]):
            policy = (
                policy_type(acquisitions=8)
                if policy_type is Exhaustive
                else policy_type(acquisitions=8, early_end=False)
            )
            for angle_deg, intensity in arranged:
                policy.tell(sample(angle_deg, intensity))
            answers.append(policy.estimate())
    assert answers[0] == answers[1]
    assert answers[2] == answers[3]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: WeightedAverage(acquisitions=1), "acquisitions is 1, at least 2"),
        (lambda: WeightedAverage(acquisitions=8, start_deg=math.inf), "start_deg is inf"),
        (lambda: ScriptedManual(acquisitions=16, start_deg=math.nan), "start_deg is nan"),
        (lambda: Posterior(start_deg=math.nan), "start_deg is nan"),
        (lambda: Posterior(others=math.nan), "others is nan, it must be a probability"),
        (lambda: Posterior(others=1.0), "others is 1.0, it must be a probability"),
        (lambda: Posterior(target_sigma_deg=math.nan), "target_sigma_deg is nan"),
        (lambda: Exhaustive(acquisitions=2), "acquisitions is 2, at least 3"),
    ],
)
def test_refuses(make, message):
    with pytest.raises(ConfigError, match=message):
        make()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (sample(1.0, math.nan), "intensity is nan"),
        (sample(1.0, math.inf), "intensity is inf"),
        (sample(1.0, -0.5), "decibels"),
        (sample(math.nan, 1.0), "angle_deg is nan"),
    ],
)
def test_refuses_samples(bad, message):
    with pytest.raises(SearchError, match=message):
        WeightedAverage(acquisitions=8).tell(bad)


class TestUncertainty:
    def test_noise_is_propagated_through_eq_1(self):
        """Against a Monte Carlo of eq. (1) where all samples stay above the threshold."""
        rng = np.random.default_rng(1)
        angle_deg = np.linspace(-10, 10, 21)
        values = 1 / (1 + (angle_deg / 8) ** 2)
        noisy = values + 0.01 * rng.standard_normal((4000, 21))
        measured = weighted_average(np.broadcast_to(angle_deg, noisy.shape), noisy).std()
        noise_free_deg = average_sigma_deg(curve(angle_deg, values), step_deg=1.0, noise_sigma=0.0)
        noisy_deg = average_sigma_deg(curve(angle_deg, values), step_deg=1.0, noise_sigma=0.01)
        # The curve touches both ends, so noise counts twice there: in the average and in its paired check.
        assert math.sqrt((noisy_deg**2 - noise_free_deg**2) / 2) == pytest.approx(measured, rel=0.05)

    def test_a_coarse_step_shows(self):
        angle_deg = np.linspace(-35, 35, 8)
        spike = np.where(angle_deg == 5, 1.0, 0.0)
        assert average_sigma_deg(curve(angle_deg, spike), step_deg=10.0, noise_sigma=0.0) > 1.4

    def test_a_curve_cut_by_the_range_shows(self):
        """The answer is biased inwards by degrees, and its interval covers that."""
        policy = WeightedAverage(acquisitions=36)
        run(policy, lambda angle: 1 / (1 + ((angle - 28) / 8) ** 2))
        estimate = policy.estimate()
        assert abs(estimate.mean_deg - 28) > 1
        assert estimate.interval95_deg.low_deg <= 28 <= estimate.interval95_deg.high_deg


class TestExhaustive:
    @given(marker_deg=st.floats(-30, 30), fwhm_deg=st.floats(3, 17))
    def test_vertex_without_noise(self, marker_deg, fwhm_deg):
        policy = Exhaustive(acquisitions=141)
        run(policy, lambda angle: 1 / (1 + (2 * (angle - marker_deg) / fwhm_deg) ** 2))
        assert policy.estimate().mean_deg == pytest.approx(marker_deg, abs=0.05)

    def test_fit_agrees_with_polyfit(self):
        rng = np.random.default_rng(2)
        angle_deg = np.linspace(-5, 5, 21)
        values = 10 - 0.05 * (angle_deg - 0.8) ** 2 + 0.1 * rng.standard_normal(21)
        vertex_deg, _ = fit_top(curve(angle_deg, values), step_deg=0.5, noise_sigma=0.0)
        bend, slope, _ = np.polyfit(angle_deg, values, 2)
        assert vertex_deg == pytest.approx(-slope / (2 * bend))

    def test_the_largest_sample_at_an_end_answers(self):
        policy = Exhaustive(acquisitions=29)
        run(policy, math.exp)
        assert policy.estimate().mean_deg == 35


class TestPeak:
    def test_triangle(self):
        peak = peak_of(curve([-3, -2, -1, 0, 1, 2, 3], [0, 1, 2, 3, 2, 1, 0]))
        assert (peak.max_deg, peak.max_intensity) == (0, 3)
        assert peak.com_deg == pytest.approx(0)
        assert peak.cen_deg == pytest.approx(0)
        assert peak.fwhm_deg == pytest.approx(3)

    def test_half_a_peak_counts_twice(self):
        peak = peak_of(curve([0, 1, 2, 3], [3, 2, 1, 0]))
        assert peak.fwhm_deg == pytest.approx(3)
        assert peak.cen_deg is None

    @pytest.mark.parametrize("floor", [0.0, 0.1, 0.3])
    def test_the_centre_of_mass_is_that_of_the_peak_whatever_the_noise_floor(self, floor):
        angles = np.arange(-35, 35.1, 0.5)
        heights = floor + np.exp(-(((angles - 20) / 4) ** 2))
        assert peak_of(curve(angles, heights)).com_deg == pytest.approx(20, abs=0.05)

    @pytest.mark.parametrize("values", [[1, 1, 1], [0, 0, 0]])
    def test_flat_has_no_width(self, values):
        peak = peak_of(curve([-1, 0, 1], values))
        assert (peak.fwhm_deg, peak.com_deg) == (None, 0)
        assert noise_limit_deg(curve([-1, 0, 1], values), noise_sigma=2.0) == 2

    def test_samples_are_put_in_order_of_the_angle(self):
        drawn = curve_of([sample(3.0, 1.0), sample(-1.0, 2.0), sample(2.0, 5.0)])
        np.testing.assert_array_equal(drawn.angle_deg, [-1, 2, 3])
        np.testing.assert_array_equal(drawn.intensity, [2, 5, 1])
        assert drawn.strongest == 1
