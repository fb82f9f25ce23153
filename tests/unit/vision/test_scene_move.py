"""Moves of a scene, one after the other and back, against SciPy's rotations and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.vision import SceneMove

POINT_M = np.array([0.012, -0.008, 0.09])


def move(seed: int) -> SceneMove:
    """A move of some degrees and millimetres, with correlated errors."""
    rng = np.random.default_rng(seed)
    root = np.diag([0.1, 0.2, 0.15, 0.05, 0.06, 0.3]) @ (np.eye(6) + 0.2 * rng.standard_normal((6, 6)))
    displacement, rotation = rng.uniform(-6, 6, (2, 3)).tolist()
    return SceneMove(
        displacement_mm=tuple(displacement),
        rotation_deg=tuple(rotation),
        middle_mm=tuple((np.array([0, 0, 85]) + rng.uniform(-5, 5, 3)).tolist()),
        covariance=tuple(tuple(row) for row in (root @ root.T).tolist()),
    )


def moved_m(each: SceneMove, point_m: np.ndarray, error: np.ndarray | None = None) -> np.ndarray:
    """The point after a move, by SciPy; ``error``: of its rotation (deg) and displacement (mm)."""
    error = np.zeros(6) if error is None else error
    middle_m = 1e-3 * np.array(each.middle_mm)
    before_m = middle_m - 1e-3 * np.array(each.displacement_mm)
    turned_m = Rotation.from_rotvec(each.rotation_deg, degrees=True).apply(point_m - before_m)
    return Rotation.from_rotvec(error[:3], degrees=True).apply(turned_m) + middle_m + 1e-3 * error[3:]


def test_moves_one_after_the_other_are_one_move() -> None:
    first = move(1)
    later = move(2)
    there_m, _ = first.then(later).carried(POINT_M, np.zeros((3, 3)))
    np.testing.assert_allclose(there_m, moved_m(later, moved_m(first, POINT_M)), atol=1e-12)


def test_a_move_and_its_way_back_lead_nowhere() -> None:
    there_m, _ = move(3).carried(POINT_M, np.zeros((3, 3)))
    back_m, _ = move(3).back().carried(there_m, np.zeros((3, 3)))
    np.testing.assert_allclose(back_m, POINT_M, atol=1e-12)
    whole = move(3).back().back()
    np.testing.assert_allclose(whole.displacement_mm, move(3).displacement_mm, atol=1e-9)
    np.testing.assert_allclose(whole.covariance, move(3).covariance, atol=1e-9)


def test_the_errors_of_two_moves_add_up_as_those_of_points_that_are_drawn() -> None:
    rng = np.random.default_rng(4)
    first = move(5)
    later = move(6)
    roots = [np.linalg.cholesky(np.array(each.covariance)) for each in (first, later)]
    drawn = []
    for _ in range(20_000):
        on_m = moved_m(first, POINT_M, roots[0] @ rng.standard_normal(6))
        drawn.append(moved_m(later, on_m, roots[1] @ rng.standard_normal(6)))
    _, said_m2 = first.then(later).carried(POINT_M, np.zeros((3, 3)))
    np.testing.assert_allclose(np.cov(np.array(drawn).T), said_m2, rtol=0.08, atol=4e-9)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"displacement_mm": (1e6, 0.0, 0.0)}, "within ± 10000 is possible"),
        ({"rotation_deg": (float("nan"), 0.0, 0.0)}, "within ± 10000 is possible"),
        ({"covariance": ((1.0,),)}, "which is none of a motion"),
        ({"covariance": tuple(tuple(row) for row in np.diag([1, 1, 1, 1, 1, -1.0]).tolist())}, "none of a motion"),
    ],
)
def test_numbers_that_are_no_move_are_refused(changed: dict[str, object], message: str) -> None:
    values = {name: getattr(move(1), name) for name in move(1).__struct_fields__}
    with pytest.raises(ConfigError, match=message):
        SceneMove(**(values | changed))
