"""The paper's figures for bracket searches and sweeps, replayed without noise, and the failures of its rules.

Figures: physics notes, "The paper's numbers". The replay of 20,000 markers is vectorised; it is first shown to ask and
answer as `BracketSearch` does.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import golden

from markerseek.core import Reading, Sample, SearchPlan
from markerseek.search import GOLDEN, TERNARY, BracketSearch, WeightedAverage, build

MARKERS = 20_000


def curve(distance_deg):
    """A symmetric unimodal curve with tails that fall as 1/t², FWHM 10°."""
    return 1 / (1 + (distance_deg / 5) ** 2)


def replay(intensity, *, ratio, acquisitions, markers):
    """Angles asked, shape (acquisitions, markers), and answers of the paper's search; intensity(angle, markers)."""
    low = np.full(markers.shape, -35.0)
    high = np.full(markers.shape, 35.0)
    asked = []
    for _ in range(acquisitions // 2):
        left = ratio * low + (1 - ratio) * high
        right = (1 - ratio) * low + ratio * high
        goes_left = intensity(left, markers) >= intensity(right, markers)
        low = np.where(goes_left, low, left)
        high = np.where(goes_left, right, high)
        asked += [left, right]
    return np.array(asked), (low + high) / 2


def run(policy, intensity):
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(Sample(angle_deg=angle_deg, reading=Reading(intensity=float(intensity(angle_deg)))))
    return np.array(asked), policy.estimate()


@pytest.fixture
def markers():
    return np.random.default_rng(2024).uniform(-35, 35, MARKERS)


@pytest.mark.parametrize("ratio", [GOLDEN, TERNARY])
@pytest.mark.parametrize("acquisitions", [2, 16, 28])
def test_the_vectorised_replay_is_the_policy(ratio, acquisitions, markers):
    few = markers[:100]
    asked, answers = replay(
        lambda angle, marker: curve(angle - marker), ratio=ratio, acquisitions=acquisitions, markers=few
    )
    for index, marker in enumerate(few):
        policy_asked, estimate = run(
            BracketSearch(ratio=ratio, acquisitions=acquisitions), lambda angle, at=marker: curve(angle - at)
        )
        np.testing.assert_array_equal(policy_asked, asked[:, index])
        assert estimate.mean_deg == answers[index]


@pytest.mark.parametrize(
    ("ratio", "acquisitions", "mean_error_deg", "tolerance_deg"),
    [(GOLDEN, 28, 0.012, 0.0006), (TERNARY, 28, 0.027, 0.0006), (TERNARY, 16, 0.32, 0.006)],
    ids=["GSS 28", "TS 28", "TS 16"],
)
def test_mean_error_without_noise(ratio, acquisitions, mean_error_deg, tolerance_deg, markers):
    _, answers = replay(
        lambda angle, marker: curve(angle - marker), ratio=ratio, acquisitions=acquisitions, markers=markers
    )
    assert np.abs(answers - markers).mean() == pytest.approx(mean_error_deg, abs=tolerance_deg)


@pytest.mark.parametrize("ratio", [GOLDEN, TERNARY])
def test_published_rules_answer_without_a_marker(ratio):
    """86–87 % of the answers to mere noise lie more than 4.33° from a marker that is not there.

    The share follows from where markers are thought to be: a guess is within 4.33° of a marker uniform in ±32° in
    13.5 % of cases, in ±35° in 12.4 % at most.
    """
    rng = np.random.default_rng(7)
    absent = rng.uniform(-32, 32, MARKERS)
    _, answers = replay(lambda angle, _: rng.rayleigh(size=angle.shape), ratio=ratio, acquisitions=28, markers=absent)
    assert np.mean(np.abs(answers - absent) > 4.33) == pytest.approx(0.865, abs=0.01)


@pytest.mark.parametrize("name", ["weighted-average", "golden-section", "ternary", "golden-section-reuse"])
def test_published_methods_always_answer(name):
    rng = np.random.default_rng(3)
    for intensity in (lambda _: rng.rayleigh(), lambda _: 0.0, lambda _: 1.0):
        _, estimate = run(build(SearchPlan(method=name, as_published=True)), intensity)
        assert type(estimate).__name__ == "Found"


@pytest.mark.parametrize("marker_deg", [-20.0, 3.3, 11.17])
def test_golden_section_asks_where_scipy_does(marker_deg):
    """With the kept point reused; SciPy minimises, and begins with the middle point of its bracket and the ends."""
    visited = []

    def negative(angle_deg):
        visited.append(float(angle_deg))
        return -curve(angle_deg - marker_deg)

    first = GOLDEN * -35 + (1 - GOLDEN) * 35
    golden(negative, brack=(-35.0, first, 35.0), tol=1e-6)
    asked, estimate = run(
        BracketSearch(ratio=GOLDEN, acquisitions=25, reuse=True), lambda angle: curve(angle - marker_deg)
    )
    scipy_asked = [angle for angle in visited if angle not in (-35.0, 35.0)]
    scipy_asked = [angle for index, angle in enumerate(scipy_asked) if angle not in scipy_asked[:index]]
    # SciPy writes the golden ratio with eight digits.
    np.testing.assert_allclose(asked, scipy_asked[:25], atol=1e-4)
    assert estimate.mean_deg == pytest.approx(marker_deg, abs=1e-3)


@pytest.mark.parametrize("marker_deg", [-10.0, 0.0, 2.5, 7.5])
def test_weighted_average_is_exact_where_samples_pair_up(marker_deg):
    """On a curve that lies inside the range, with the marker on a sample or midway between two, eq. (1) is exact."""
    _, estimate = run(
        WeightedAverage(acquisitions=15, early_end=False), lambda angle: math.exp(-(((angle - marker_deg) / 6) ** 2))
    )
    assert estimate.mean_deg == pytest.approx(marker_deg, abs=1e-12)


def test_early_end_spares_a_quarter_of_the_scan(markers):
    """From −35° in 5° steps as in Table 2 (8.7 acquisitions, 0.53°, on nine markers that are not public)."""
    counts = []
    errors = []
    for marker in markers[:1000]:
        if abs(marker) > 25:
            continue
        asked, estimate = run(
            WeightedAverage(acquisitions=15), lambda angle, at=marker: math.exp(-(((angle - at) / 6) ** 2))
        )
        counts.append(asked.size)
        errors.append(abs(estimate.mean_deg - marker))
    assert np.mean(counts) == pytest.approx(11, abs=1)
    assert np.mean(errors) < 0.53
