"""The bounds against finite differences, closed forms, published figures, and estimators by Monte Carlo."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.bounds import (
    NUISANCES,
    TABLE_PRIOR,
    IntensityNoise,
    Prior,
    SampledCurve,
    SlopedCurve,
    angle_bound_deg,
    best_angles,
    sample_information,
)
from markerseek.core import ConfigError, Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class TailedCurve:
    """S(t) = (1 + (2^(q/p) − 1)·(2|t|/F)^q)^(−p/q), or the Gaussian 2^(−(2t/F)²) where p is infinite.

    F is the full width at half maximum, p the exponent of the tails, q the sharpness of the knee.
    """

    fwhm_deg: float
    tail: float = math.inf
    knee: float = 2.0

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""
        scaled = 2 * np.abs(off_deg) / self.fwhm_deg
        if math.isinf(self.tail):
            return np.asarray(np.exp2(-(scaled**2)))
        return np.asarray((1 + (2 ** (self.knee / self.tail) - 1) * scaled**self.knee) ** (-self.tail / self.knee))

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""
        scaled = 2 * np.abs(off_deg) / self.fwhm_deg
        inner = np.sign(off_deg) * 2 / self.fwhm_deg
        if math.isinf(self.tail):
            return np.asarray(-2 * math.log(2) * scaled * inner * np.exp2(-(scaled**2)))
        strength = 2 ** (self.knee / self.tail) - 1
        base = 1 + strength * scaled**self.knee
        return np.asarray(
            -self.tail * strength * scaled ** (self.knee - 1) * inner * base ** (-self.tail / self.knee - 1)
        )


GAUSSIAN = TailedCurve(fwhm_deg=10.0)
SPEED_TABLE = IntensityNoise(snr=1 / 0.03)
"""Curve and noise of the table in the speed notes: full width 10 degrees, noise 3 % of the peak."""

MEAN_OF_ROOT = math.sqrt(2 / math.pi)
"""Mean magnitude of a normal error over its standard deviation; the table names means."""

CURVES: dict[str, SlopedCurve] = {
    "gaussian": GAUSSIAN,
    "heavy tails": TailedCurve(fwhm_deg=5.0, tail=1.0, knee=2.0),
    "sharp knee": TailedCurve(fwhm_deg=8.0, tail=1.2, knee=5.0),
}


@pytest.mark.parametrize("jitter", [0.0, 0.03])
@pytest.mark.parametrize("curve", CURVES.values(), ids=list(CURVES))
def test_information_is_the_bend_of_the_divergence(curve: SlopedCurve, jitter: float) -> None:
    """KL divergence of the samples' distributions, by itself: δᵀIδ/2 for a small change δ of all parameters."""
    angles = np.array([-8.0, -1.5, 0.7, 2.6, 6.1])
    marker_deg = 0.4
    snr = 40.0

    def distribution(change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle, amplitude, width, tail, floor = change
        t = (angles - marker_deg - angle) / math.exp(width)
        mean = snr * math.exp(amplitude) * curve.value(t) ** (1 + tail) + floor
        return mean, 1 + (jitter * mean) ** 2

    information = sample_information(
        curve, angles, marker_deg=marker_deg, noise=IntensityNoise(snr=snr, jitter=jitter)
    ).sum(axis=0)
    rng = np.random.default_rng(3)
    mean, variance = distribution(np.zeros(5))
    for _ in range(20):
        change = 1e-4 * rng.standard_normal(5) * [1, 1, 1, 1, 30]
        divergence = 0.0
        for sign in (1, -1):
            other, others = distribution(sign * change)
            divergence += 0.5 * np.sum(np.log(others / variance) + (variance + (mean - other) ** 2) / others - 1) / 2
        assert divergence == pytest.approx(change @ information @ change / 2, rel=1e-3)


@pytest.mark.parametrize(("acquisitions", "published"), [(6, 0.068), (8, 0.059), (10, 0.053), (16, 0.042), (28, 0.032)])
def test_best_places_of_a_gaussian_of_known_shape(acquisitions: int, published: float) -> None:
    """All on the flanks at ±σ of the curve: σ_θ = (σ/A)·s·e^(1/2)/√N; and the speed notes' means."""
    best = best_angles(
        GAUSSIAN, marker_deg=3.0, noise=SPEED_TABLE, acquisitions=acquisitions, unknown=(), step_deg=0.05
    )
    width = 10 / (2 * math.sqrt(2 * math.log(2)))
    closed = 0.03 * width * math.exp(0.5) / math.sqrt(acquisitions)
    assert best.bound_deg == pytest.approx(closed, rel=1e-3)
    assert np.abs(np.array(best.angles_deg) - 3.0) == pytest.approx(width, abs=0.05)
    assert best.bound_deg * MEAN_OF_ROOT == pytest.approx(published, abs=6e-4)


def test_what_is_unknown_costs_and_what_is_known_helps() -> None:
    angles = np.array([-6.0, -3.0, 0.5, 2.0, 7.0, 20.0])
    information = sample_information(
        CURVES["heavy tails"], angles, marker_deg=0.3, noise=IntensityNoise(snr=100.0, jitter=0.01)
    ).sum(axis=0)
    bounds = [angle_bound_deg(information, unknown=NUISANCES[:count]) for count in range(5)]
    assert all(fewer <= more * (1 + 1e-9) for fewer, more in pairwise(bounds))
    assert angle_bound_deg(information, prior=TABLE_PRIOR) < bounds[-1]
    assert np.isinf(angle_bound_deg(np.zeros((5, 5))))
    assert angle_bound_deg(np.zeros((5, 5)), prior=TABLE_PRIOR) == pytest.approx(70 / math.sqrt(12))


def test_no_other_angles_do_better_than_the_best() -> None:
    curve = CURVES["heavy tails"]
    noise = IntensityNoise(snr=100.0, jitter=0.008)
    best = best_angles(curve, marker_deg=-31.0, noise=noise, acquisitions=6, prior=TABLE_PRIOR)
    assert all(-35 <= angle <= 35 for angle in best.angles_deg)
    rng = np.random.default_rng(1)
    for _ in range(300):
        angles = np.clip(-31.0 + 4 * rng.standard_normal(6), -35, 35)
        other = sample_information(curve, angles, marker_deg=-31.0, noise=noise).sum(axis=0)
        assert angle_bound_deg(other, prior=TABLE_PRIOR) >= best.bound_deg * (1 - 1e-3)


@pytest.mark.parametrize(
    "make",
    [
        lambda: IntensityNoise(snr=math.nan),
        lambda: IntensityNoise(snr=10.0, jitter=1.5),
        lambda: Prior(tail=0.0),
        lambda: SampledCurve(np.array([0.0, 1.0, 1.0]), np.ones(3)),
        lambda: SampledCurve(np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.0, 0.5])),
        lambda: best_angles(GAUSSIAN, marker_deg=0.0, noise=SPEED_TABLE, acquisitions=0),
    ],
)
def test_what_cannot_be_is_refused(make: object) -> None:
    with pytest.raises(ConfigError):
        make()  # type: ignore[operator]
