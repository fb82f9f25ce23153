"""Breathing of several shapes: its period, its swing, its direction and its pause."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.vision import DisplacementSeries, tissue_motion

DIRECTION = np.array([0.6, -0.64, 0.48])
SIGMA_MM = np.array([0.02, 0.02, 0.08])
RATE_HZ = 10.0


def series(along_mm: np.ndarray, *, seed: int = 1, offset_mm: float = 0.0) -> DisplacementSeries:
    rng = np.random.default_rng(seed)
    at_s = 100.0 + np.arange(len(along_mm)) / RATE_HZ
    moved_mm = along_mm[:, None] * DIRECTION + offset_mm + SIGMA_MM * rng.standard_normal((len(along_mm), 3))
    covariances = np.tile(1e-6 * np.diag(SIGMA_MM**2), (len(along_mm), 1, 1))
    return DisplacementSeries(at_s=at_s, displacements_m=1e-3 * moved_mm, covariances_m2=covariances)


def breathing(swing_mm: float, period_s: float, *, seconds: float = 24.0, power: int = 3, phase: float = 0.3):
    """Displacement from the end of exhalation: a power of a squared sine, which pauses at 0."""
    turns = np.arange(round(seconds * RATE_HZ)) / RATE_HZ / period_s + phase
    return swing_mm * np.sin(np.pi * turns) ** (2 * power)


@pytest.mark.parametrize("period_s", [2.5, 3.3, 4.0, 5.0])
@pytest.mark.parametrize("swing_mm", [0.6, 2.0, 6.0])
@pytest.mark.parametrize("power", [1, 2, 3])
def test_breathing_is_measured(period_s: float, swing_mm: float, power: int) -> None:
    found = tissue_motion(series(breathing(swing_mm, period_s, power=power), offset_mm=0.5))
    assert found is not None
    assert found.period_s == pytest.approx(period_s, rel=0.02)
    assert found.amplitude_mm == pytest.approx(swing_mm / 2, rel=0.08)
    assert np.dot(np.abs(found.direction), np.abs(DIRECTION)) > 0.98
    if power > 1:
        # The pause is at 0, so that the swing points away from it.
        assert np.dot(found.swing_mm, DIRECTION) > 0
        np.testing.assert_allclose(found.rest_mm, 0.5, atol=0.05 + 0.05 * swing_mm)


def test_in_the_pause_the_tissue_is_near_its_rest() -> None:
    swing_mm = 2.0
    period_s = 4.0
    along_mm = breathing(swing_mm, period_s)
    found = tissue_motion(series(along_mm), gate_mm=0.2)
    assert found is not None
    at_s = (100.0 + np.arange(len(along_mm)) / RATE_HZ).tolist()
    inside = np.array([found.in_pause(each) for each in at_s])
    assert along_mm[inside].max() < 0.35
    # 0.2 mm of 2 mm: sin⁶ stays below a tenth for 52 % of the cycle.
    assert np.mean(inside) == pytest.approx(0.52, abs=0.1)
    # It goes on: a minute later the pause comes at the same phase.
    assert found.in_pause(at_s[int(np.argmax(inside))] + 15 * period_s + 0.3)


def test_irregular_breathing_has_about_its_period() -> None:
    rng = np.random.default_rng(3)
    cycles = [breathing(rng.uniform(1.6, 2.4), 4.0 * rng.uniform(0.95, 1.05), seconds=4.0, phase=0) for _ in range(8)]
    found = tissue_motion(series(np.concatenate(cycles)))
    assert found is not None
    assert found.period_s == pytest.approx(4.0, rel=0.06)
    assert found.amplitude_mm == pytest.approx(1.0, rel=0.2)


def test_the_swing_is_as_near_as_its_covariance_says() -> None:
    squares = []
    for seed in range(80):
        found = tissue_motion(series(breathing(1.0, 4.0, power=1), seed=seed))
        assert found is not None
        miss = np.array(found.swing_mm)
        miss = miss - math.copysign(1.0, miss @ DIRECTION) * DIRECTION
        squares.append(miss @ np.linalg.solve(np.array(found.covariance_mm2), miss))
    assert np.mean(np.array(squares) <= 7.815) > 0.85


@pytest.mark.parametrize("seed", range(20))
def test_noise_is_no_motion(seed: int) -> None:
    assert tissue_motion(series(np.zeros(200), seed=seed)) is None


def test_motion_without_a_period_is_said_to_have_none() -> None:
    steps = np.cumsum(np.random.default_rng(4).standard_normal(200)) * 0.2
    found = tissue_motion(series(steps))
    assert found is not None
    if found.period_s is None:
        assert found.pause_at_s is None
        assert not found.in_pause(100.0)


def test_half_a_breath_has_no_period() -> None:
    found = tissue_motion(series(breathing(2.0, 5.0, seconds=2.5)))
    assert found is not None
    assert found.period_s is None


def test_a_few_times_say_nothing() -> None:
    assert tissue_motion(series(np.zeros(5))) is None


@pytest.mark.parametrize("seed", range(20))
def test_tissue_that_is_seen_in_a_part_of_each_breath_moves_all_the_same(seed: int) -> None:
    # Pairs from the pause and both flanks beside it: a third of the cycle is open.
    whole = series(breathing(2.0, 4.0, power=2, phase=0.5), seed=seed)
    phases = (whole.at_s - whole.at_s[0]) / 4.0 % 1.0
    near = np.abs(phases - 0.5) < 0.3
    found = tissue_motion(
        DisplacementSeries(
            at_s=whole.at_s[near],
            displacements_m=whole.displacements_m[near],
            covariances_m2=whole.covariances_m2[near],
        )
    )
    assert found is not None
    # As far as it was seen: 2 mm · sin⁴ of 0.3 half turns is 0.86 mm, so that nothing says that it moves by ± 1 mm.
    assert 0.2 < found.amplitude_mm < 1.5
    assert np.dot(np.abs(found.direction), np.abs(DIRECTION)) > 0.95
