"""More samples never hurt: the error of the angle over the number of samples, on curves that are not of the family."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from markerseek.core import Reading, Sample
from markerseek.search.posterior import Posterior

pytestmark = pytest.mark.usefixtures("unchecked_shapes")

CELLS = 6000

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
        self._curve, self._peak, self._rng = CURVES[number % 3], 10 ** (snr_db / 20), rng

    def sample(self, angle_deg: float, *, dark: bool = False) -> Sample:
        height = 0.0 if dark else self._peak * self._curve((angle_deg - self.angle_deg) / self._fwhm_deg)
        own = math.hypot(height + self._rng.standard_normal(), self._rng.standard_normal())
        largest = math.sqrt(2 * math.log(CELLS / 2 / self._rng.standard_exponential()))
        return Sample(
            angle_deg=angle_deg,
            dark=dark,
            reading=Reading(intensity=max(own, largest), noise_sigma=1.0, cells=CELLS),
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
                burst = Reading(intensity=3 * sample.reading.intensity, noise_sigma=1.0, cells=CELLS)
                sample = Sample(angle_deg=sample.angle_deg, reading=burst)
            policy.tell(sample)
    assert policy.estimate().mean_deg == pytest.approx(marker.angle_deg, abs=0.1)
