"""What frames show of a marker's motion, against Monte Carlo of the model, and what answers make of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy import integrate, stats

from markerseek.core import Estimate, Finished, Float64, Found, Reading, RunPlan, Sample, SweepTiming, Unsure
from markerseek.rigs import Rig, of_intensities, simulated
from markerseek.scan import run
from markerseek.search.posterior import Posterior
from markerseek.search.posterior.motion import (
    OVERALL_M,
    PLACE_SIGMAS_M,
    SIGMA_OF_AMPLITUDE,
    SIGMAS_M,
    along_turn,
    log_likelihoods,
    motion_of,
    overall_prior,
    period_s,
)
from markerseek.sim import GaussianCurve, MarkerSettings, ReceiverSettings, SimulatedSettings, TissueMotion

RADIUS_M = 60e-3


def sample(angle_deg: float, *, lateral_m: float = 0.0, depth_m: float = 50e-3, snr: float = 60.0) -> Sample:
    reading = Reading(
        intensity=snr, lateral_m=lateral_m, depth_m=depth_m, noise_sigma=1.0, cells=1000, focused_coherence=1.0
    )
    return Sample(angle_deg=angle_deg, reading=reading)


def slant_m(away_deg: float | Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, ...]:
    """Distance of the marker from a face 10 mm from the axis, at angles from the image plane."""
    return np.asarray(np.sqrt(0.01**2 + RADIUS_M**2 - 2 * 0.01 * RADIUS_M * np.cos(np.radians(away_deg))))


def test_the_likelihood_of_places_is_that_of_a_student_distribution() -> None:
    """Against SciPy's density, the mean integrated out by quadrature."""
    place_m = np.array([0.0, 0.1e-3, -0.05e-3, 0.3e-3])
    noise_m = np.full(4, 0.02e-3)
    logs = log_likelihoods(place_m, noise_m)
    assert logs.size > 20
    expected = []
    for sigma_m in (0.0, 3e-3):
        scale_m = math.hypot(0.02e-3, sigma_m)

        def density(mean_m: float, scale_m: float = scale_m) -> float:
            return float(np.prod(stats.t.pdf(place_m, 4, loc=mean_m, scale=scale_m) * 1e-3))

        expected.append(math.log(integrate.quad(density, -0.07e-3, 0.32e-3, limit=200)[0]))
    assert logs[-1] - logs[0] == pytest.approx(expected[1] - expected[0], abs=0.1)


def test_along_the_turn_there_is_what_any_direction_leaves() -> None:
    """Against motions drawn from the prior, of which those are kept that fit what is seen."""
    rng = np.random.default_rng(4)
    count = 400_000
    sigma_m = np.exp(rng.uniform(np.log(OVERALL_M[0]), np.log(OVERALL_M[-1]), count))
    direction = np.abs(rng.standard_normal((count, 3)))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    turn_m, lateral_m, depth_m = (sigma_m[:, None] * direction).T
    place_m = 0.5e-3 * np.array([[1.0, 0.3], [-1.0, -0.3], [0.2, 0.1], [-0.9, -0.2], [0.8, 0.2]])
    noise_m = np.full(5, 0.02e-3)
    logs = log_likelihoods(place_m[:, 0], noise_m), log_likelihoods(place_m[:, 1], noise_m)
    log_weight = np.interp(lateral_m, PLACE_SIGMAS_M, logs[0]) + np.interp(depth_m, PLACE_SIGMAS_M, logs[1])
    weight = np.exp(log_weight - log_weight.max())
    expected_m2 = float(weight @ turn_m**2 / weight.sum())
    moving = np.concatenate([[0.0], np.full(OVERALL_M.size, 1 / OVERALL_M.size)])
    found = along_turn(moving, logs)
    assert found[0] == 0
    assert found.sum() == pytest.approx(1.0)
    assert float(found @ SIGMAS_M**2) == pytest.approx(expected_m2, rel=0.2)
    median_m = np.sort(turn_m)[np.searchsorted(np.cumsum(weight[np.argsort(turn_m)]), weight.sum() / 2)]
    assert np.interp(median_m, SIGMAS_M, np.cumsum(found)) == pytest.approx(0.5, abs=0.15)


def test_a_stated_motion_is_the_prior() -> None:
    assert overall_prior(0.0)[0] == 1
    assert overall_prior(None)[0] == pytest.approx(0.9)
    stated = overall_prior(1e-3)
    assert stated[0] == 0
    assert math.exp(float(stated[1:] @ np.log(OVERALL_M))) == pytest.approx(SIGMA_OF_AMPLITUDE * 1e-3, rel=0.02)


def moved_samples(*, amplitude_m: float, seed: int = 3) -> list[Sample]:
    """Samples about 0°, displaced in depth and along the array, the slant range of their angles included."""
    rng = np.random.default_rng(seed)
    angles_deg = rng.uniform(-3, 3, 8)
    way_m = amplitude_m * np.sin(rng.uniform(0, 2 * math.pi, 8))
    noise_m = 8e-6 * rng.standard_normal((8, 2))
    return [
        sample(angle_deg, lateral_m=0.6 * way + noise[0], depth_m=slant + 0.8 * way + noise[1])
        for angle_deg, way, slant, noise in zip(
            angles_deg.tolist(), way_m.tolist(), slant_m(angles_deg).tolist(), noise_m.tolist(), strict=True
        )
    ]


def test_motion_is_seen_in_depth_and_along_the_array_and_rest_is_rest() -> None:
    still = motion_of(moved_samples(amplitude_m=0.0), mean_deg=0.0, sigma=1.0)
    assert (still.lateral_m, still.depth_m) == (0.0, 0.0)
    # The other is motion just along the turn: a tenth moves, and of that a fifth along the turn.
    assert still.probability[0] == pytest.approx(0.9 / (0.9 + 0.1 * 0.2))
    moving = motion_of(moved_samples(amplitude_m=0.8e-3), mean_deg=0.0, sigma=1.0)
    assert moving.probability[0] < 1e-6
    assert moving.depth_m == pytest.approx(0.64e-3, rel=0.5)
    assert moving.lateral_m == pytest.approx(0.48e-3, rel=0.5)
    # Which displacement each sample has, is known up to its sign and size.
    way_m = np.array([each.reading.lateral_m for each in moved_samples(amplitude_m=0.8e-3)])
    assert abs(np.corrcoef(way_m, moving.relative_displacement)[0, 1]) > 0.99
    assert moving.relative_sigma.max() < 0.4


@pytest.mark.parametrize("true_s", [3.1, 4.0, 5.6])
def test_the_period_of_a_breath_is_that_of_its_places(true_s: float) -> None:
    """Breaths with a pause, seen at irregular times; the periodogram is of a sine."""
    rng = np.random.default_rng(8)
    times_s = np.cumsum(rng.uniform(0.7, 1.6, 16))
    place_m = 1e-3 * np.cos(np.pi * times_s / true_s) ** 4 + 2e-5 * rng.standard_normal(16)
    assert period_s(times_s, place_m, np.full(16, 2e-5)) == pytest.approx(true_s, rel=0.06)


def test_noise_has_no_period() -> None:
    """One in a hundred at most, by its definition."""
    rng = np.random.default_rng(9)
    periods = [period_s(np.cumsum(rng.uniform(0.7, 1.6, 12)), rng.standard_normal(12), np.ones(12)) for _ in range(300)]
    assert sum(each is not None for each in periods) <= 8
    assert period_s(np.arange(5.0), np.array([0.0, 1.0, 0.0, -1.0, 0.0]), np.ones(5)) is None


def test_what_shows_no_place_says_nothing_of_motion() -> None:
    bare = [replace(each, reading=Reading(intensity=50.0)) for each in moved_samples(amplitude_m=1e-3)]
    motion = motion_of(bare, mean_deg=0.0, sigma=1.0)
    assert (motion.lateral_m, motion.depth_m, motion.looked_at) == (None, None, False)
    assert motion.probability[0] == 1.0
    assert motion_of(bare, mean_deg=0.0, sigma=1.0, stated_m=1e-3).probability[0] == 0.0
    assert motion.relative_sigma.tolist() == [1.0] * 8


def test_the_pulses_of_one_way_are_one_moment() -> None:
    """Fifty pulses beside one another do not show that a marker rests."""

    def way(number: int, *, lateral_m: float, speed_deg_s: float) -> list[Sample]:
        timing = SweepTiming(number=number, speed_deg_s=speed_deg_s)
        return [replace(sample(0.1 * k, lateral_m=lateral_m), sweep=timing) for k in range(-10, 11)]

    one = motion_of(way(1, lateral_m=0.0, speed_deg_s=20.0), mean_deg=0.0, sigma=1.0)
    assert not one.looked_at
    there_and_back = way(1, lateral_m=0.0, speed_deg_s=20.0) + way(1, lateral_m=0.6e-3, speed_deg_s=-20.0)
    two = motion_of(there_and_back, mean_deg=0.0, sigma=1.0)
    assert two.lateral_m is not None
    assert two.lateral_m > 0.1e-3
    assert two.probability[0] < 0.05


def rig_settings(**motion: object) -> SimulatedSettings:
    return SimulatedSettings(
        marker=MarkerSettings(angle_deg=7.0, lateral_m=3e-3),
        receiver=ReceiverSettings(readout_s=0.05),
        motion=TissueMotion(phase=0.3, **motion),  # type: ignore[arg-type]
    )


def answer_of(policy: Posterior, rig: Rig) -> Estimate:
    (finished,) = [event for event in run(policy, rig.scanner, RunPlan(stay=True)) if isinstance(event, Finished)]
    return finished.estimate


def test_a_marker_that_rests_is_found_and_the_answer_says_that_it_rests() -> None:
    found = answer_of(Posterior(), simulated(seed=2, settings=rig_settings()))
    assert isinstance(found, Found)
    assert found.motion is not None
    assert (found.motion.lateral_mm, found.motion.depth_mm, found.motion.is_seen) == (0.0, 0.0, False)


def test_a_marker_that_moves_far_is_unsure_by_name_and_with_a_cure() -> None:
    settings = rig_settings(breathing_mm=1.5, direction=(0.6, 0.6, 0.5))
    answer = answer_of(Posterior(), simulated(seed=2, settings=settings))
    assert isinstance(answer, Unsure)
    assert answer.motion is not None
    assert answer.motion.is_seen
    # First of all, whatever else is doubtful because of it.
    assert answer.reason.startswith("the marker moves by ± ") or answer.doubt == "width"
    assert "the marker moves by ± " in answer.reason
    assert "hold the ventilation for the " in answer.reason
    assert answer.sigma_deg > 0.5


def test_a_stated_motion_widens_the_interval_of_intensities() -> None:
    def half_deg(motion_mm: float | None) -> float:
        rig = of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=6.0), marker_deg=4.0)
        answer = answer_of(Posterior(motion_mm=motion_mm), rig)
        assert isinstance(answer, Found | Unsure)
        assert answer.motion is not None
        assert answer.motion.depth_mm is None
        return answer.interval95_deg.width_deg / 2

    # ± 0.3 mm at 55 mm: 0.22 mm or 0.23° a standard deviation along the line.
    assert half_deg(0.3) > half_deg(0.0) + 0.05
    assert half_deg(2.0) > half_deg(0.3)


def sample_about_7_deg(angle_deg: float, *, moved_deg: float = 0.0) -> Sample:
    """Sample of a marker at 7° with a Gaussian curve of 4°, displaced just along the turn: its places stay."""
    away_deg = angle_deg - 7.0 - moved_deg
    snr = math.hypot(4.0, 100 * math.exp(-4 * math.log(2) * (away_deg / 4.0) ** 2))
    return sample(angle_deg, depth_m=float(slant_m(angle_deg - 7.0)), snr=snr)


def searched(*, moved_deg: float, motion_mm: float | None = None) -> tuple[Estimate, list[float]]:
    """Answer and angles of a search for a marker at 7° that is elsewhere when an angle is measured again."""
    policy = Posterior(motion_mm=motion_mm)
    angles_deg: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        again = any(abs(angle_deg - each) < 0.05 for each in angles_deg)
        policy.tell(sample_about_7_deg(angle_deg, moved_deg=moved_deg if again else 0.0))
        angles_deg.append(angle_deg)
    return policy.estimate(), angles_deg


def test_a_search_ends_with_a_flank_that_was_measured_before() -> None:
    """Frames show no motion just along the turn; the same flank at another time does."""
    answer, angles_deg = searched(moved_deg=0.0)
    assert isinstance(answer, Found)
    assert answer.motion is not None
    assert answer.motion.turn_sigma_mm < 0.1
    *before, last = angles_deg
    assert min(abs(each - last) for each in before) < 0.05
    # Where a curve of 4° is steep.
    assert 0.8 < abs(last - 7.0) < 3.2


def test_what_differs_there_is_motion_by_name() -> None:
    answer, angles_deg = searched(moved_deg=1.0)
    assert isinstance(answer, Unsure)
    assert "the marker moves along the turn" in answer.reason
    assert answer.motion is not None
    # 1° at 50 mm before the face is 1 mm; the two samples differ by it.
    assert 0.3 < answer.motion.turn_sigma_mm < 3.0
    assert len(angles_deg) > len(searched(moved_deg=0.0)[1])


@pytest.mark.parametrize("motion_mm", [None, 0.0, 0.3])
def test_an_angle_that_a_recording_has_twice_is_read_whatever_is_stated_of_the_tissue(motion_mm: float | None) -> None:
    policy = Posterior(motion_mm=motion_mm)
    angles_deg = (-20.0, -8.0, 2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 20.0, 30.0, 5.0)
    policy.tell_recorded(sample_about_7_deg(each) for each in angles_deg)
    answer = policy.estimate()
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(7.0, abs=0.05)
    assert answer.motion is not None
    assert answer.motion.turn_looked_at
    assert (answer.motion.turn_sigma_mm > 0.05) == (motion_mm == 0.3)


def test_no_flank_is_measured_again_in_tissue_that_is_stated_to_rest() -> None:
    _, angles_deg = searched(moved_deg=0.0, motion_mm=0.0)
    assert len(angles_deg) == len(searched(moved_deg=0.0)[1]) - 1
