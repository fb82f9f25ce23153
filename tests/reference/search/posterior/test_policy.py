"""Whole searches by the posterior: accuracy and calibration, by small Monte Carlo runs with fixed seeds.

Curves as in ``tests/reference/search/test_checked.py``: full widths of 3–17° and tails as 1/|t| to 1/|t|^2.5. More
samples never hurt: the error of the angle falls with their number, also on curves that are not of the family.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from markerseek.core import Ambiguous, AtBound, Found, Interval, NotFound, Reading, Sample, Unsure
from markerseek.search.posterior import Posterior
from markerseek.search.posterior.shapes import log_curve
from markerseek.search.posterior.survey import acquisitions_needed
from tests.reference.search.test_checked import CELLS, noise_maximum, shape

pytestmark = pytest.mark.usefixtures("unchecked_shapes")


def search(policy, *, rng, sigma, markers, fwhm_deg=6.0, tail=1.3, outlier=None):
    """Answer of a search, and the number of acquisitions; frame number ``outlier`` holds a burst."""

    def reading(signal, lateral_m):
        largest = float(noise_maximum(rng, sigma))
        envelope = abs(signal + sigma * complex(*rng.standard_normal(2)))
        if envelope < largest:
            envelope = largest
            lateral_m = float(rng.uniform(-27e-3, 27e-3))
        return Reading(intensity=envelope, noise_sigma=sigma, cells=CELLS, lateral_m=lateral_m, depth_m=40e-3)

    for _ in range(3):
        policy.tell(Sample(angle_deg=0.0, reading=reading(0.0, 0.0), dark=True))
    count = 0
    while (angle_deg := policy.ask()) is not None:
        signal = max((shape(angle_deg - marker, fwhm_deg, tail) for marker in markers), default=0.0)
        measured = reading(signal, 5e-3 + 0.01e-3 * rng.standard_normal())
        if count == outlier:
            measured = Reading(intensity=0.7, noise_sigma=sigma, cells=CELLS, lateral_m=-20e-3, depth_m=40e-3)
        policy.tell(Sample(angle_deg=angle_deg, reading=measured))
        count += 1
    return policy.estimate(), count


def campaign(searches, *, seed, sigma, acquisitions, target_sigma_deg=0.0, outlier=None, others=0.05):
    rng = np.random.default_rng(seed)
    found = []
    for index in range(searches):
        marker_deg = rng.uniform(-35, 35)
        policy = Posterior(acquisitions=acquisitions, target_sigma_deg=target_sigma_deg, others=others)
        answer, count = search(
            policy,
            rng=rng,
            sigma=sigma,
            markers=[marker_deg],
            fwhm_deg=(3.0, 5.0, 10.0, 17.0)[index % 4],
            tail=rng.uniform(1, 2.5),
            outlier=outlier,
        )
        found.append((marker_deg, answer, count))
    return found


def test_eight_acquisitions_at_40_db():
    answers = campaign(40, seed=1, sigma=0.01, acquisitions=8)
    assert np.mean([abs(answer.mean_deg - truth) for truth, answer, _ in answers]) < 0.3
    sure = [(truth, answer) for truth, answer, _ in answers if isinstance(answer, Found | Unsure)]
    assert len(sure) >= 36
    assert np.mean([truth in answer.interval95_deg for truth, answer in sure]) > 0.88


@pytest.mark.long
@pytest.mark.parametrize("outlier", [None, 1, 4])
def test_found_is_right_with_a_outlier_frame_and_without(outlier):
    answers = campaign(20, seed=2, sigma=10**-1.5, acquisitions=12, outlier=outlier, others=0.0)
    found = [(truth, answer) for truth, answer, _ in answers if isinstance(answer, Found)]
    assert len(found) > 5
    assert not [answer for truth, answer in found if abs(answer.mean_deg - truth) > 1]


def test_stops_when_it_is_sure():
    answers = campaign(20, seed=3, sigma=0.003, acquisitions=30, target_sigma_deg=0.15)
    assert np.mean([count for *_, count in answers]) < 14
    assert all(isinstance(answer, Found) for _, answer, count in answers if count < 30)
    assert np.mean([abs(answer.mean_deg - truth) for truth, answer, _ in answers]) < 0.15


@pytest.mark.parametrize(("marker_deg", "side"), [(-40.0, "low"), (40.0, "high")])
def test_a_marker_beyond_the_range(marker_deg, side):
    answer, _ = search(
        Posterior(acquisitions=12, target_sigma_deg=0.0),
        rng=np.random.default_rng(5),
        sigma=0.003,
        markers=[marker_deg],
        fwhm_deg=8.0,
    )
    assert isinstance(answer, AtBound)
    assert answer.side == side
    assert answer.mean_deg == math.copysign(35.0, marker_deg)


def test_two_markers_are_never_one():
    """Two equal ones 30° apart: both named, or nothing claimed between them."""
    rng = np.random.default_rng(6)
    for _ in range(10):
        low_deg = rng.uniform(-30, 0)
        markers = [low_deg, low_deg + 30]
        answer, _ = search(Posterior(acquisitions=16), rng=rng, sigma=0.01, markers=markers)
        near = min(abs(answer.mean_deg - marker) for marker in markers)
        assert near < 1 or not isinstance(answer, Found)
        if isinstance(answer, Ambiguous):
            assert len(answer.modes_deg) > 1


@pytest.mark.parametrize("peak", [10.0, 31.6])
def test_the_number_that_would_do(peak):
    """With it no marker of that height lies where all samples are below the level; with two fewer some do."""
    limits = Interval(low_deg=-35.0, high_deg=35.0)
    level = 6.4
    needed = acquisitions_needed(limits, level=level, peak=peak, fwhm_deg=3.0)
    markers_deg = np.linspace(-35, 35, 1401)

    def detected(count):
        angles_deg = limits.low_deg + limits.width_deg * (np.arange(count) + 0.5) / count
        near_deg = np.abs(markers_deg[:, None] - angles_deg).min(axis=1)
        return peak * np.exp(log_curve(near_deg, fwhm_deg=3.0, tail=1.2, knee=2.4)) >= level * (1 - 1e-9)

    assert detected(needed).all()
    assert not detected(needed - 2).all()


def test_a_budget_too_small_for_the_noise_is_reported():
    rng = np.random.default_rng(8)
    few, _ = search(Posterior(acquisitions=8), rng=rng, sigma=1.0, markers=[])
    assert "8 acquisitions may have missed a marker 20 dB above the noise" in few.reason
    needed = int(few.reason.split("; with ")[1].split()[0])
    assert 25 <= needed <= 40
    enough, _ = search(Posterior(acquisitions=needed + 2), rng=rng, sigma=1.0, markers=[])
    assert isinstance(enough, NotFound)
    assert "missed" not in enough.reason


def test_clutter_is_not_detected_as_the_marker():
    """A weak source is detected first, a marker eight times as strong is missed: found, or nothing is claimed."""
    rng = np.random.default_rng(9)
    for _ in range(6):
        clutter_deg = rng.uniform(-30, -20)

        def reading(angle_deg, clutter_deg=clutter_deg):
            there = 0.12 * shape(angle_deg - clutter_deg, 3.0, 1.3), shape(angle_deg - 11.0, 3.0, 2.5)
            largest = int(np.argmax(there))
            signal = abs(there[largest] + 0.01 * complex(*rng.standard_normal(2)))
            return Reading(intensity=signal, noise_sigma=0.01, cells=CELLS, lateral_m=(-9e-3, 5e-3)[largest])

        policy = Posterior(acquisitions=12)
        while (angle_deg := policy.ask()) is not None:
            policy.tell(Sample(angle_deg=angle_deg, reading=reading(angle_deg)))
        answer = policy.estimate()
        assert not isinstance(answer, Found) or abs(answer.mean_deg - 11) < 1


IMAGE_CELLS = 6000

CURVES: tuple[Callable[[float], float], ...] = (
    lambda t: 1 / math.cosh(2 * math.acosh(2) * t),
    lambda t: (math.exp(-4 * math.log(2) * t**2) + 0.25 * math.exp(-4.3 * (abs(t) - 1) ** 2)) / 1.004,
    lambda t: 1 / (1 + (2 * abs(t)) ** 1.6),
)
"""An exponential tail, a shoulder, and a cusp, over the distance in units of the width."""

MARKERS = range(len(CURVES))
"""One of each."""


class Marker:
    """A marker whose intensities have noise of σ = 1, and the largest noise of an image."""

    def __init__(self, number: int, *, snr_db: float) -> None:
        rng = np.random.default_rng([77, number])
        self.angle_deg = float(rng.uniform(-33, 33))
        self._fwhm_deg = math.exp(rng.uniform(math.log(2.5), math.log(12)))
        self._curve = CURVES[number % 3]
        self._peak = 10 ** (snr_db / 20)
        self._rng = rng

    def sample(self, angle_deg: float, *, dark: bool = False) -> Sample:
        height = 0.0 if dark else self._peak * self._curve((angle_deg - self.angle_deg) / self._fwhm_deg)
        own = math.hypot(height + self._rng.standard_normal(), self._rng.standard_normal())
        largest = math.sqrt(2 * math.log(IMAGE_CELLS / 2 / self._rng.standard_exponential()))
        return Sample(
            angle_deg=angle_deg,
            dark=dark,
            reading=Reading(intensity=max(own, largest), noise_sigma=1.0, cells=IMAGE_CELLS),
        )


def told(marker: Marker, count: int) -> Posterior:
    policy = Posterior(acquisitions=count, target_sigma_deg=0.0, others=0.0)
    for _ in range(3):
        policy.tell(marker.sample(0.0, dark=True))
    return policy


def sweep_error_deg(number: int, count: int, *, snr_db: float) -> float:
    """Error of the mean after a sweep of that many angles, whatever the answer."""
    marker = Marker(number, snr_db=snr_db)
    policy = told(marker, count)
    for angle_deg in np.linspace(-35, 35, count).tolist():
        policy.tell(marker.sample(angle_deg))
    return abs(policy.estimate().mean_deg - marker.angle_deg)


def search_errors_deg(number: int, counts: list[int], *, snr_db: float) -> list[float]:
    """Errors of one long search after these numbers of acquisitions, whatever the answers."""
    marker = Marker(number, snr_db=snr_db)
    policy = told(marker, max(counts))
    errors_deg = []
    for count in range(1, max(counts) + 1):
        asked_deg = policy.ask()
        assert asked_deg is not None
        policy.tell(marker.sample(asked_deg))
        if count in counts:
            errors_deg.append(abs(policy.estimate().mean_deg - marker.angle_deg))
    return errors_deg


@pytest.mark.long
@pytest.mark.parametrize(("snr_db", "least_deg"), [(80.0, 0.02), (40.0, 0.05), (25.0, 0.3)])
def test_a_sweep_of_more_angles_is_more_exact(snr_db, least_deg):
    mean_deg = [
        float(np.mean([sweep_error_deg(number, count, snr_db=snr_db) for number in MARKERS])) for count in (30, 200)
    ]
    assert mean_deg[1] <= 1.1 * mean_deg[0]
    assert mean_deg[1] < least_deg


@pytest.mark.long
@pytest.mark.parametrize(("snr_db", "least_deg"), [(80.0, 0.01), (40.0, 0.02)])
def test_a_longer_search_is_more_exact(snr_db, least_deg):
    counts = [10, 20, 40, 80]
    mean_deg = np.mean([search_errors_deg(number, counts, snr_db=snr_db) for number in range(6)], axis=0)
    assert mean_deg[-1] < least_deg
    assert mean_deg[-1] <= 1.1 * mean_deg[0]


def test_an_outlier_among_repeats_does_not_move_the_angle():
    """Two of 60 samples are bursts of three times their intensity, at angles that were measured ten times each."""
    marker = Marker(1, snr_db=40.0)
    policy = told(marker, 60)
    for repeat in range(10):
        for offset_deg in (-4.0, -2.0, -1.0, 1.0, 2.0, 4.0):
            sample = marker.sample(marker.angle_deg + offset_deg)
            if repeat in (3, 7) and offset_deg == 2.0:
                burst = Reading(intensity=3 * sample.reading.intensity, noise_sigma=1.0, cells=IMAGE_CELLS)
                sample = Sample(angle_deg=sample.angle_deg, reading=burst)
            policy.tell(sample)
    assert policy.estimate().mean_deg == pytest.approx(marker.angle_deg, abs=0.1)
