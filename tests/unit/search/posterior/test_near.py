"""A prior over the angle says where a search looks first, and is no part of its answer."""

from __future__ import annotations

import math
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import stats

from markerseek import find_marker, rigs, simulated
from markerseek.core import (
    PAPER_RANGE,
    Ambiguous,
    AnglePrior,
    ConfigError,
    Found,
    Interval,
    MarkerCurve,
    NotFound,
    Reading,
    Sample,
    SearchPlan,
)
from markerseek.search import build, most_acquisitions
from markerseek.search.posterior import Posterior
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.survey import WRONG, ExpectedAngle, survey_angles_deg
from tests.unit.search.posterior.test_sources import arrival, sample

NEAR = AnglePrior(mean_deg=-20.0, sigma_deg=2.0)
CELLS = 100_000


def height(angle_deg: float, *, peak: float, fwhm_deg: float = 6.0) -> float:
    return peak / (1 + (2 * angle_deg / fwhm_deg) ** 2) ** 0.75


def intensities(marker_deg: float, *, peak: float = 60.0, seed: int = 1):
    """What a rig without positions measures."""
    rng = np.random.default_rng(seed)

    def measure(angle_deg: float) -> Sample:
        noise = math.sqrt(2 * math.log(CELLS) + 2 * rng.standard_exponential())
        value = (1 + 0.02 * rng.standard_normal()) * height(angle_deg - marker_deg, peak=peak)
        reading = Reading(intensity=max(value, noise), noise_sigma=1.0, cells=CELLS)
        return Sample(angle_deg=angle_deg, reading=reading)

    return measure


def sources(**places: tuple[float, float, float]):
    """What a rig with positions measures: each source by its angle, peak, and place along the array in mm."""

    def measure(angle_deg: float) -> Sample:
        heights = [(height(angle_deg - at, peak=peak), lateral) for at, peak, lateral in places.values()]
        return sample(angle_deg, *(arrival(value, lateral, 40.0) for value, lateral in heights if value > 6.0))

    return measure


def search(policy: Posterior, measure) -> list[float]:
    """The angles that a policy asks for."""
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(measure(angle_deg))
        assert len(asked) <= 2 * 16
    return asked


@pytest.mark.parametrize("near", [NEAR, replace(NEAR, mean_deg=20.0), AnglePrior.of_table([-20, -18, 5], [1, 1, 0])])
def test_the_same_samples_give_the_same_angle_sigma_and_interval_with_any_prior(near: AnglePrior) -> None:
    measure = intensities(-18.5)
    lit = [measure(each) for each in (-30.0, -22.0, -19.0, -17.0, -14.0, 0.0, 12.0, 25.0)]
    with_prior = Posterior(near=near)
    without = Posterior()
    for policy in (with_prior, without):
        policy.tell_recorded(lit)
    one = with_prior.estimate()
    other = without.estimate()
    assert (one.mean_deg, one.sigma_deg, one.interval95_deg) == (other.mean_deg, other.sigma_deg, other.interval95_deg)
    assert one.surveyed == other.surveyed
    assert isinstance(other, Found)


@pytest.mark.parametrize(("off_deg", "sigma_deg"), [(0.0, 1.0), (1.5, 1.0), (-4.0, 3.0)])
def test_with_a_right_prior_a_search_takes_at_most_two_thirds(off_deg: float, sigma_deg: float) -> None:
    usual = 0
    guided = 0
    for seed in range(5):
        marker_deg = -24.0 + 11.0 * seed
        near = AnglePrior(mean_deg=marker_deg + off_deg, sigma_deg=sigma_deg)
        policy = Posterior(near=near)
        guided += len(search(policy, sources(marker=(marker_deg, 80.0, 5.0))))
        answer = policy.estimate()
        evidence = policy.near_evidence
        assert isinstance(answer, Found)
        assert answer.mean_deg == pytest.approx(marker_deg, abs=0.6)
        assert evidence is not None
        assert evidence.probability > 0.9
        assert not evidence.whole_range
        usual += len(search(Posterior(), sources(marker=(marker_deg, 80.0, 5.0))))
    assert guided <= usual * 2 / 3


@pytest.mark.parametrize(("marker_deg", "measured"), [(-5.0, "positions"), (10.0, "intensities"), (34.0, "positions")])
def test_a_wrong_prior_costs_acquisitions_and_not_truth(marker_deg: float, measured: str) -> None:
    policy = Posterior(near=NEAR)
    rig = sources(marker=(marker_deg, 80.0, 5.0)) if measured == "positions" else intensities(marker_deg)
    asked = search(policy, rig)
    answer = policy.estimate()
    evidence = policy.near_evidence
    usual = Posterior()
    search(usual, rig)
    assert type(answer) is type(usual.estimate())
    assert answer.mean_deg == pytest.approx(marker_deg, abs=1.0)
    assert evidence is not None
    assert evidence.probability < 1e-3
    assert evidence.whole_range
    # As safe as a search without a prior: the range was surveyed.
    assert answer.surveyed == pytest.approx(1.0, abs=0.06)
    assert min(asked) < -15.0


def test_a_weak_source_where_the_prior_expects_the_marker_is_not_taken_for_it() -> None:
    """The prior is wrong, and clutter is where it points: the marker is seen from there, and stronger."""
    policy = Posterior(near=NEAR)
    search(policy, sources(marker=(-6.0, 100.0, 5.0), clutter=(-20.0, 25.0, -15.0)))
    answer = policy.estimate()
    evidence = policy.near_evidence
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(-6.0, abs=0.5)
    assert [round(each.angle_deg) for each in answer.others] == [-20]
    assert evidence is not None
    assert evidence.whole_range


def test_a_prior_at_the_other_of_two_sources_as_loud_is_not_contradicted() -> None:
    policy = Posterior(near=NEAR)
    search(policy, sources(stronger=(5.0, 100.0, 5.0), other=(-20.0, 92.0, -15.0)))
    answer = policy.estimate()
    evidence = policy.near_evidence
    assert isinstance(answer, Ambiguous)
    assert answer.mean_deg == pytest.approx(5.0, abs=0.5)
    assert evidence is not None
    assert evidence.probability > 0.9


def test_a_source_much_weaker_than_the_former_marker_is_not_believed() -> None:
    """Nothing else tells that clutter from the marker, which cannot be seen from the window."""
    rig = sources(marker=(25.0, 100.0, 5.0), clutter=(-20.0, 25.0, -15.0))
    policy = Posterior(near=NEAR, prior=MarkerCurve(fwhm_deg=6.0, peak=100.0))
    search(policy, rig)
    answer = policy.estimate()
    evidence = policy.near_evidence
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(25.0, abs=0.5)
    assert evidence is not None
    assert evidence.whole_range


def test_where_nothing_is_found_the_whole_range_is_searched_with_acquisitions_anew() -> None:
    policy = Posterior(near=NEAR, acquisitions=10)
    asked = search(policy, sources())
    assert isinstance(policy.estimate(), NotFound)
    window = NEAR.interval(PAPER_RANGE)
    inside = [each in window for each in asked]
    # Eight, as many as miss the fewest markers.
    assert inside[:8] == [True] * 8
    assert len(asked) == 8 + 10
    outside = sorted(each for each, is_inside in zip(asked, inside, strict=True) if not is_inside)
    assert np.diff([window.high_deg, *outside]).max() < 15.0
    assert most_acquisitions(SearchPlan(acquisitions=10, near=NEAR)) == 20


@pytest.mark.parametrize("marker_deg", [-34.0, 34.5])
def test_at_an_end_of_the_range_no_angle_beyond_it_is_asked_for(marker_deg: float) -> None:
    policy = Posterior(near=AnglePrior(mean_deg=marker_deg, sigma_deg=2.0))
    asked = search(policy, sources(marker=(marker_deg, 80.0, 5.0)))
    assert all(each in PAPER_RANGE for each in asked)
    assert policy.estimate().mean_deg == pytest.approx(marker_deg, abs=1.0)


def test_a_prior_outside_of_the_range_or_for_another_method_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"near: 50±2 deg lies outside of \[-35, 35\] deg"):
        build(SearchPlan(near=AnglePrior(mean_deg=50.0, sigma_deg=2.0)))
    with pytest.raises(ConfigError, match="ternary: near is given, but only the posterior has this setting"):
        build(SearchPlan(method="ternary", near=NEAR))


def known(angle_deg: float) -> Mock:
    """A posterior that knows the angle to 0.1 degrees."""
    posterior = Mock(spec=AnglePosterior)
    posterior.cumulative = partial(stats.norm.cdf, loc=angle_deg, scale=0.1)
    return posterior


@pytest.mark.parametrize("angle_deg", [-20.0, -17.0, -14.0, -12.0, 10.0])
def test_the_probability_that_it_is_wrong_is_that_of_bayes_rule(angle_deg: float) -> None:
    near = replace(NEAR, sigma_deg=4.0)
    right = (1 - WRONG) * stats.norm.pdf(angle_deg, -20.0, 4.0)
    wrong = WRONG / PAPER_RANGE.width_deg
    expected = ExpectedAngle(near, limits=PAPER_RANGE)
    assert expected.wrong_probability(known(angle_deg)) == pytest.approx(wrong / (wrong + right), rel=0.05)
    # What hides is weighed by the same density.
    weights = expected.weights(known(-20.0))
    angles_deg = survey_angles_deg(PAPER_RANGE)
    assert weights[np.argmin(np.abs(angles_deg + 20.0))] == pytest.approx(1.0, rel=0.01)
    assert weights[-1] == pytest.approx(wrong / (wrong + 0.95 * stats.norm.pdf(0.0, 0.0, 4.0)), rel=0.05)


def test_beyond_the_range_a_marker_contradicts_it() -> None:
    assert ExpectedAngle(NEAR, limits=PAPER_RANGE).wrong_probability(known(50.0)) == pytest.approx(1.0)
    assert ExpectedAngle(NEAR, limits=Interval(low_deg=-30.0, high_deg=0.0)).window.low_deg == -30.0


def test_a_result_says_what_was_seen_of_it() -> None:
    rig = simulated(seed=4)
    result = find_marker(rig, SearchPlan(near=AnglePrior(mean_deg=16.0, sigma_deg=2.0)))
    assert result.found
    assert result.error_deg is not None
    assert result.error_deg < 0.5
    rows = dict(result.rows)
    assert rows["prior"] == "16 ± 2°: contradicted, probability < 0.1 %; the whole range was searched"
    assert result.near_evidence is not None
    assert result.near_evidence.whole_range
    assert "prior" not in dict(find_marker(simulated(seed=4)).rows)


def test_a_recording_has_the_prior_for_its_search_alone(tmp_path) -> None:
    measure = intensities(-18.0)
    bank = tmp_path / "scan.csv"
    angles = np.arange(-35.0, 35.5, 1.0).tolist()
    bank.write_text("angle_deg,intensity\n" + "".join(f"{each},{measure(each).reading.intensity}\n" for each in angles))
    with_prior = find_marker(rigs.replayed(bank), SearchPlan(near=NEAR))
    without = find_marker(rigs.replayed(bank))
    assert (with_prior.angle_deg, with_prior.sigma_deg) == (without.angle_deg, without.sigma_deg)
    assert with_prior.near_evidence is not None
    assert with_prior.search is not None
    assert with_prior.search.samples[0].angle_deg in NEAR.interval(PAPER_RANGE)
