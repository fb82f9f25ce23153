"""The prior over the angle: its texts, its table, its window, and what it refuses."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from markerseek.core import PAPER_RANGE, AnglePrior, ConfigError, Interval, PriorEvidence

ANGLES = st.floats(-30.0, 30.0)
SIGMAS = st.floats(0.1, 20.0)


@pytest.mark.parametrize(
    "text", ["-12.5±2", "−12.5 ± 2°", "-12.5+-2", "-12.5+/-2 deg", "-12.5 2", "-12.5,2", " -12.5° ± 2.0° "]
)
def test_an_angle_with_its_sigma_is_read_in_all_usual_forms(text: str) -> None:
    assert AnglePrior.parse(text) == AnglePrior(mean_deg=-12.5, sigma_deg=2.0)


@given(ANGLES, SIGMAS, st.lists(st.just(0.0) | st.floats(1e-100, 1e100), min_size=2, max_size=6).filter(any))
def test_its_text_is_read_as_the_same_prior(mean_deg: float, sigma_deg: float, weights: list[float]) -> None:
    normal = AnglePrior(mean_deg=mean_deg, sigma_deg=sigma_deg)
    assert AnglePrior.parse(str(normal)) == normal
    table = AnglePrior.of_table([mean_deg + 0.5 * step for step in range(len(weights))], weights)
    assert AnglePrior.parse(str(table)) == table


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("12.5", "as in 12.5±2"),
        ("nan±2", "as in 12.5±2"),
        ("8:1 9:x", "as in 8:1 9:3 10:1"),
        ("1e3±2", r"mean_deg is 1000.0 deg, it must lie in \[-180, 180\] deg"),
        ("12±0", r"sigma_deg is 0.0 deg, it must lie in \[0.1, 45\] deg"),
        ("8:1", "1 angles and 1 weights, a table needs 2"),
        ("9:1 8:1", "do not ascend"),
        ("8:0 9:0", "all weights of the table are 0"),
        ("8:1 9:-1", r"the weight at 9 deg is -1.0, it must be 0 or lie in \[1e-100, 1e\+100\]"),
        ("8:0 9:5e-324", "the weight at 9 deg is 5e-324"),
        ("8:1 9:inf", "the weight at 9 deg is inf"),
        ("8:1 nan:1", "an angle of the table is nan"),
    ],
)
def test_what_is_no_prior_is_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        AnglePrior.parse(text)


@pytest.mark.parametrize(("mean_deg", "sigma_deg"), [(math.nan, 2.0), (12.0, math.nan), (math.inf, 2.0)])
def test_a_number_that_is_not_finite_is_refused(mean_deg: float, sigma_deg: float) -> None:
    with pytest.raises(ConfigError, match="near: "):
        AnglePrior(mean_deg=mean_deg, sigma_deg=sigma_deg)


@given(ANGLES, SIGMAS, st.floats(-40.0, 40.0))
def test_the_normal_distribution_is_that_of_scipy(mean_deg: float, sigma_deg: float, angle_deg: float) -> None:
    below = AnglePrior(mean_deg=mean_deg, sigma_deg=sigma_deg).below(angle_deg)
    assert below == pytest.approx(stats.norm.cdf(angle_deg, mean_deg, sigma_deg), abs=1e-12)


def test_a_table_has_the_moments_of_its_density() -> None:
    # A triangle: c = 1/4 of its width from the low end.
    table = AnglePrior.of_table([2.0, 5.0, 14.0], [0.0, 7.0, 0.0])
    triangle = stats.triang(0.25, 2.0, 12.0)
    assert table.mean_deg == pytest.approx(triangle.mean())
    assert table.sigma_deg == pytest.approx(triangle.std())
    for angle_deg in (1.0, 3.0, 5.0, 9.0, 20.0):
        assert table.below(angle_deg) == pytest.approx(triangle.cdf(angle_deg))


@given(ANGLES, st.floats(0.1, 8.0))
def test_the_window_holds_the_prior_and_the_flanks_and_stays_in_the_range(mean_deg: float, sigma_deg: float) -> None:
    window = AnglePrior(mean_deg=mean_deg, sigma_deg=sigma_deg).interval(PAPER_RANGE)
    assert PAPER_RANGE.low_deg <= window.low_deg < window.high_deg <= PAPER_RANGE.high_deg
    for side in (-1, 1):
        # A marker two sigmas off still has the steepest part of its flank, of a curve 10 degrees wide.
        assert PAPER_RANGE.nearest(mean_deg + side * (2 * sigma_deg + 5.0)) in window


def test_the_window_of_a_table_is_the_shortest_that_holds_its_mass() -> None:
    two_peaks = AnglePrior.of_table([-20.0, -10.0, -9.0, -8.0, 3.0, 4.0, 5.0, 30.0], [0, 0, 1, 0, 0, 1, 0, 0])
    window = two_peaks.interval(PAPER_RANGE)
    assert window.low_deg == pytest.approx(-10.0 - 5.0, abs=0.6)
    assert window.high_deg == pytest.approx(5.0 + 5.0, abs=0.6)


def test_a_prior_at_an_end_of_the_range_keeps_what_is_inside() -> None:
    assert AnglePrior(mean_deg=36.0, sigma_deg=2.0).interval(PAPER_RANGE) == Interval(low_deg=25.0, high_deg=35.0)


@pytest.mark.parametrize("text", ["50±2", "-40±2", "40:1 42:1"])
def test_a_prior_outside_of_the_range_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"lies outside of \[-35, 35\] deg; correct the angle, leave it out"):
        AnglePrior.parse(text).interval(PAPER_RANGE)


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        (
            PriorEvidence(probability=1e-5, whole_range=True),
            "12.5 ± 2°: contradicted, probability < 0.1 %; the whole range was searched",
        ),
        (PriorEvidence(probability=0.9996, whole_range=False), "12.5 ± 2°: not contradicted, probability 99 %"),
        (
            PriorEvidence(probability=0.7, whole_range=True),
            "12.5 ± 2°: not contradicted, probability 70 %; the whole range was searched",
        ),
    ],
)
def test_what_was_seen_of_it_is_said_in_words(evidence: PriorEvidence, said: str) -> None:
    assert evidence.said(AnglePrior(mean_deg=12.5, sigma_deg=2.0)) == said
