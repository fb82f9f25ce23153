"""The offset of a camera's clock from flashes that it saw: simulated cameras of several exposures."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek.vision import clock_offset


def seen(
    offset_s: float, *, exposure_s: float, repetition_hz: float = 17.0, seed: int = 1, wrong_share: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of pairs, which of them are lit, and flashes, in three bursts."""
    rng = np.random.default_rng(seed)
    begins_s = np.array([1.0, 3.1, 4.7]) + rng.uniform(0, 0.3, 3)
    flashes_s = np.concatenate([begin_s + np.arange(0, 0.8, 1 / repetition_hz) for begin_s in begins_s])
    pairs_s = np.arange(0, 7, 1 / 29.97) + rng.normal(0, 5e-4, 210)[: len(np.arange(0, 7, 1 / 29.97))]
    lit = np.array([((flashes_s > each - exposure_s) & (flashes_s <= each)).any() for each in pairs_s])
    lit ^= rng.random(len(lit)) < wrong_share
    return pairs_s + offset_s, lit, flashes_s


@pytest.mark.parametrize("offset_s", [-0.8, 0.0, 0.043, 1.2])
@pytest.mark.parametrize("exposure_s", [0.02, 0.033])
def test_the_offset_is_found(offset_s: float, exposure_s: float) -> None:
    found = clock_offset(*seen(offset_s, exposure_s=exposure_s))
    assert found is not None
    assert found.offset_s == pytest.approx(offset_s, abs=4 * found.sigma_s)
    assert found.sigma_s < 0.02
    assert found.rig_s(10.0 + offset_s) == pytest.approx(10.0, abs=0.05)


def test_sigmas_hold_the_truth_as_often_as_they_say() -> None:
    misses = []
    for seed in range(40):
        found = clock_offset(*seen(0.3, exposure_s=0.012, repetition_hz=10.0, seed=seed, wrong_share=0.01), within_s=1)
        # A burst of even flashes may fall between all exposures of a camera.
        if found is not None:
            misses.append(abs(found.offset_s - 0.3) / found.sigma_s)
    assert len(misses) >= 16
    assert np.mean(np.array(misses) < 2) >= 0.88


def test_a_light_that_never_changes_says_nothing() -> None:
    pairs_s, lit, flashes_s = seen(0.1, exposure_s=0.033)
    assert clock_offset(pairs_s, np.zeros_like(lit), flashes_s) is None
    assert clock_offset(pairs_s, np.ones_like(lit), flashes_s) is None
    assert clock_offset(pairs_s, lit, flashes_s[:0]) is None


def test_an_offset_beyond_the_limit_is_not_known() -> None:
    pairs_s, lit, flashes_s = seen(5.0, exposure_s=0.033)
    assert clock_offset(pairs_s, lit, flashes_s, within_s=2.0) is None


def test_an_even_train_of_flashes_is_ambiguous() -> None:
    flashes_s = np.arange(-10, 20, 0.5)
    pairs_s = np.arange(0, 7, 1 / 30)
    lit = np.array([((flashes_s > each - 0.02) & (flashes_s <= each)).any() for each in pairs_s])
    assert clock_offset(pairs_s, lit, flashes_s, within_s=2.0) is None
