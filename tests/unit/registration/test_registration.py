"""When a registration is accepted: its residuals against what the sigmas let expect."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from markerseek.registration import PointPair, RegistrationReport, register_pairs

TRUS_M = np.array([[x, y, 60 + (x * y) % 7 / 2] for x in (-20, 0, 20) for y in (-20, 0, 20)]) * 1e-3
TURN = Rotation.from_euler("xyz", [150, 20, 40], degrees=True).as_matrix()
TRUS_SIGMA_M = np.array([0.1e-3, 0.03e-3, 0.05e-3])
CAMERA_SIGMA_M = np.array([0.02e-3, 0.02e-3, 0.5e-3])


def report(
    rng: np.random.Generator, *, count: int = 9, sigmas: bool = True, off_m: tuple[float, float, float] = (0, 0, 0)
) -> RegistrationReport:
    """Of points with the errors that their sigmas say; the second is off."""
    pairs = []
    for number, point_m in enumerate(TRUS_M[[0, 2, 6, 8, 4, 1, 3, 5, 7][:count]], start=1):
        wrong_m = np.array(off_m) if number == 2 else 0.0
        pairs.append(
            PointPair(
                name=str(number),
                trus_m=point_m + TRUS_SIGMA_M * rng.standard_normal(3) + wrong_m,
                camera_m=(point_m - [0, 0, 0.15]) @ TURN + CAMERA_SIGMA_M * rng.standard_normal(3),
                trus_covariance_m2=np.diag(TRUS_SIGMA_M**2) if sigmas else None,
                camera_covariance_m2=np.diag(CAMERA_SIGMA_M**2) if sigmas else None,
            )
        )
    return register_pairs(pairs)


@pytest.mark.parametrize("count", [4, 9])
def test_good_points_are_refused_as_often_as_the_test_says(count: int) -> None:
    rng = np.random.default_rng(count)
    probabilities = [report(rng, count=count).probability for _ in range(100)]
    assert kstest(probabilities, "uniform").pvalue > 0.01


@pytest.mark.parametrize("off_m", [(3e-3, 0, 0), (0, 3e-3, 0), (0, 0, 3e-3)])
def test_a_point_that_is_3_mm_off_is_named_among_nine(off_m: tuple[float, float, float]) -> None:
    for seed in range(5):
        said = report(np.random.default_rng(seed), off_m=off_m)
        assert not said.registered
        assert said.worst == "2"
        assert "leave it out by --without 2" in str(said.reason)


def test_where_several_points_may_be_the_wrong_one_all_are_named() -> None:
    """Any three of four corners fit where one is too high: a plane turns."""
    said = report(np.random.default_rng(2), count=4, off_m=(0, 0, 4e-3))
    assert not said.registered
    assert "but the others also fit without" in str(said.reason)


def test_without_sigmas_1_mm_is_assumed_of_each_coordinate() -> None:
    good = report(np.random.default_rng(1), sigmas=False)
    assert good.registered
    assert good.expected_fre_m == pytest.approx(1e-3 * np.sqrt(21 / 9))
    assert good.misfit == pytest.approx(9 * good.fre_m**2 / 1e-6 / 21)
    bad = report(np.random.default_rng(1), sigmas=False, off_m=(9e-3, 0, 0))
    assert not bad.registered
    assert "(FRE 2." in str(bad.reason)


def test_points_of_which_none_can_be_left_out_are_refused_too() -> None:
    said = report(np.random.default_rng(1), count=3, off_m=(12e-3, 0, 0))
    assert not said.registered
    assert "and without it the others do not fit either" not in str(said.reason)
