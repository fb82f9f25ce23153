"""Whole searches by the posterior: accuracy and calibration, by small Monte Carlo runs with fixed seeds.

Curves as in ``tests/reference/search/test_checked.py``: full widths of 3–17° and tails as 1/|t| to 1/|t|^2.5.
"""

from __future__ import annotations

import math

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
            envelope, lateral_m = largest, float(rng.uniform(-27e-3, 27e-3))
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
    limits, level = Interval(low_deg=-35.0, high_deg=35.0), 6.4
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
