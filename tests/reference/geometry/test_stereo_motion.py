"""The motion of points seen by two cameras, against SciPy's least squares, triangulation and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from markerseek.geometry import (
    CalibrationErrors,
    RangedPoints,
    RigidTransform,
    StereoCameras,
    StereoMotion,
    StereoPixels,
    at_rest,
    range_points,
    rigid_motion,
    seen_after,
    shift_between,
    triangulate,
)
from markerseek.sim.stereo_endoscope import endoscope

CAMERAS = endoscope()
SIGMA_PX = 0.1
COUNT = 200


def scene(rng: np.random.Generator) -> np.ndarray:
    """Points over the whole picture, 70 to 90 mm away."""
    across = rng.uniform(-1, 1, (COUNT, 2)) * [30e-3, 24e-3]
    return np.concatenate([across, rng.uniform(70e-3, 90e-3, (COUNT, 1))], axis=1)


def motion(turn_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> RigidTransform:
    rest = at_rest()
    rotation = Rotation.from_rotvec(turn_deg, degrees=True).as_matrix()
    return RigidTransform(
        source=rest.source, target=rest.target, rotation=rotation, translation_m=1e-3 * np.array(shift_mm)
    )


MOVE = motion((0.4, -0.3, 0.5), (0.4, -0.2, 0.3))


def ranged(points_m: np.ndarray, rng: np.random.Generator, sigma_px: float = SIGMA_PX) -> RangedPoints:
    left, right = CAMERAS.project(points_m)
    right = right + sigma_px * rng.standard_normal(right.shape)
    return range_points(left, right, np.tile(sigma_px**2 * np.eye(2), (len(left), 1, 1)), CAMERAS)


def pixels(points_m: np.ndarray, rng: np.random.Generator, sigma_px: float = SIGMA_PX) -> StereoPixels:
    left, right = CAMERAS.project(points_m)
    covariances = np.tile(sigma_px**2 * np.eye(2), (len(left), 1, 1))
    return StereoPixels(
        left_px=left + sigma_px * rng.standard_normal(left.shape),
        right_px=right + sigma_px * rng.standard_normal(right.shape),
        left_px2=covariances,
        right_px2=covariances,
    )


def parts(points: RangedPoints, across: int, down: int) -> np.ndarray:
    x, y = ((points.directions[:, :2] / [0.8, 0.7] + 0.5) * [across, down]).astype(np.int64).T
    return np.clip(y, 0, down - 1) * across + np.clip(x, 0, across - 1)


def found(
    points: RangedPoints, now: StereoPixels, *, start: RigidTransform | None = None, seed: int = 1
) -> StereoMotion | None:
    return rigid_motion(
        points,
        now,
        CAMERAS,
        start=start or at_rest(),
        parts=parts(points, 8, 6),
        regions=parts(points, 4, 3),
        rng=np.random.default_rng(seed),
    )


def error(motion_found: StereoMotion, truth: RigidTransform) -> np.ndarray:
    """Error of the rotation (rad), and of the displacement of the middle (m)."""
    transform = motion_found.transform
    turn = Rotation.from_matrix(truth.rotation @ transform.rotation.T).as_rotvec()
    middle_m = motion_found.middle_m
    return np.concatenate([turn, truth.apply(transform.inverse().apply(middle_m)) - middle_m])


def test_exact_pixels_give_the_motion() -> None:
    rng = np.random.default_rng(1)
    points_m = scene(rng)
    answer = found(ranged(points_m, rng, 1e-9), pixels(MOVE.apply(points_m), rng, 1e-9))
    assert answer is not None
    np.testing.assert_allclose(answer.transform.matrix, MOVE.matrix, atol=1e-9)
    assert answer.shared.all()


def test_points_are_where_triangulation_has_them() -> None:
    rng = np.random.default_rng(2)
    points_m = scene(rng)
    left, right = CAMERAS.project(points_m)
    right = right + 0.2 * rng.standard_normal(right.shape)
    mine = range_points(left, right, np.tile(np.eye(2), (COUNT, 1, 1)), CAMERAS)
    theirs = triangulate(left, right, CAMERAS, sigma_px=1e-3)
    # Triangulation shares the vertical error among both images; here it stays in the right one.
    np.testing.assert_allclose(mine.positions_m, theirs.points_m, atol=0.05e-3)
    np.testing.assert_allclose(seen_after(mine, at_rest(), CAMERAS)[1], right, atol=1e-9)


def test_it_is_the_maximum_of_the_likelihood() -> None:
    rng = np.random.default_rng(3)
    points_m = scene(rng)
    points = ranged(points_m, rng)
    now = pixels(MOVE.apply(points_m), rng)
    answer = found(points, now)
    assert answer is not None
    assert answer.shared.mean() > 0.98
    kept = points[answer.shared]
    seen = now[answer.shared]

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        """All errors of all pixels over their sigmas: those of the inverse depths are unknowns of their own."""
        turn = Rotation.from_rotvec(unknowns[:3]).as_matrix()
        tried = motion((0, 0, 0), (0, 0, 0))
        tried = RigidTransform(source=tried.source, target=tried.target, rotation=turn, translation_m=unknowns[3:6])
        moved = RangedPoints(
            directions=kept.directions,
            nearness_per_m=kept.nearness_per_m + unknowns[6:] * kept.sigma_per_m,
            sigma_per_m=kept.sigma_per_m,
            beside_px=kept.beside_px,
        )
        left, right = seen_after(moved, tried, CAMERAS)
        errors = np.concatenate([(left - seen.left_px).ravel(), (right - seen.right_px).ravel()]) / SIGMA_PX
        return np.concatenate([errors, unknowns[6:]])

    start = np.zeros(6 + len(kept.directions))
    start[:3] = Rotation.from_matrix(answer.transform.rotation).as_rotvec()
    start[3:6] = answer.transform.translation_m
    theirs = least_squares(residuals, start, x_scale="jac", method="trf").x
    sigmas = np.sqrt(np.diag(answer.covariance))
    np.testing.assert_allclose(
        Rotation.from_matrix(answer.transform.rotation).as_rotvec(), theirs[:3], atol=0.1 * sigmas[0]
    )
    there = Rotation.from_rotvec(theirs[:3]).apply(points_m) + theirs[3:6]
    np.testing.assert_allclose(answer.transform.apply(points_m), there, atol=3e-6)


def test_covariances_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(4)
    trials = 150
    squares = []
    for trial in range(trials):
        points_m = scene(rng)
        answer = found(ranged(points_m, rng), pixels(MOVE.apply(points_m), rng), seed=trial)
        assert answer is not None
        miss = error(answer, MOVE)
        squares.append(miss @ np.linalg.solve(answer.covariance, miss))
    # Errors that are alike over the image are in the covariances, and not in this world: more than 95 % are within.
    inside = np.mean(np.array(squares) <= 12.59)
    assert 0.93 <= inside <= 1.0
    assert 2.5 < np.mean(squares) < 7.0


def test_points_that_move_otherwise_do_not_count() -> None:
    rng = np.random.default_rng(5)
    points_m = scene(rng)
    moved_m = MOVE.apply(points_m)
    other = points_m[:, 0] > 12e-3
    moved_m[other] = points_m[other] + [2e-3, 1e-3, 0]
    answer = found(ranged(points_m, rng), pixels(moved_m, rng))
    assert answer is not None
    assert not answer.shared[other].any()
    assert answer.shared[~other].mean() > 0.98
    miss = error(answer, MOVE)
    assert miss @ np.linalg.solve(answer.covariance, miss) < 25


@pytest.mark.parametrize("width_mm", [12.0, 25.0])
def test_a_scene_that_deforms_is_uneven(width_mm: float) -> None:
    rng = np.random.default_rng(6)
    points_m = scene(rng)
    still = found(ranged(points_m, rng), pixels(points_m, rng))
    swell = np.exp(-np.sum(points_m[:, :2] ** 2, axis=1) / (2 * (1e-3 * width_mm) ** 2))
    deformed = found(ranged(points_m, rng), pixels(points_m + swell[:, None] * [1e-3, 0, 0], rng))
    assert still is not None
    assert still.unevenness < 2.5
    assert deformed is None or deformed.unevenness > 4 or deformed.shared.mean() < 0.7


def test_a_wrong_calibration_is_in_the_covariance_of_a_move_and_not_of_a_rest() -> None:
    """Moves seen through cameras with errors drawn as stated, and measured with the calibration without them."""
    rng = np.random.default_rng(11)
    stated = CalibrationErrors()
    move = motion((3, -2, 4), (4, -3, 6))
    squares = []
    exact = []
    rest = []
    for trial in range(60):
        factors = rng.standard_normal(3)
        drawn = CalibrationErrors(
            focal_share=factors[0] * stated.focal_share,
            base_share=factors[1] * stated.base_share,
            vergence_px=factors[2] * stated.vergence_px,
        )
        true = CAMERAS
        for number in range(3):
            true = drawn.displaced(true)[number]
        points_m = scene(rng) * [0.8, 0.8, 1.0]
        covariances = np.tile(SIGMA_PX**2 * np.eye(2), (COUNT, 1, 1))

        def seen(places_m: np.ndarray, true: StereoCameras = true) -> list[np.ndarray]:
            return [each + SIGMA_PX * rng.standard_normal(each.shape) for each in true.project(places_m)]

        points = range_points(true.left.project(points_m), seen(points_m)[1], covariances, CAMERAS)
        for truth, kept in ((move, squares), (at_rest(), rest)):
            left, right = seen(truth.apply(points_m))
            now = StereoPixels(left_px=left, right_px=right, left_px2=covariances, right_px2=covariances)
            for calibration, told in ((stated, kept), (None, exact if truth is move else [])):
                answer = rigid_motion(
                    points,
                    now,
                    CAMERAS,
                    start=truth,
                    parts=parts(points, 8, 6),
                    regions=parts(points, 4, 3),
                    calibration=calibration,
                    rng=np.random.default_rng(trial),
                )
                assert answer is not None
                miss = error(answer, truth)
                told.append(miss @ np.linalg.solve(answer.covariance, miss))
    assert np.mean(np.array(squares) <= 12.59) >= 0.88
    assert np.mean(np.array(rest) <= 12.59) >= 0.88
    # Without them the covariance is far too small.
    assert np.mean(np.array(exact) <= 12.59) < 0.5


def test_points_on_a_line_determine_nothing() -> None:
    rng = np.random.default_rng(7)
    points_m = np.stack([np.linspace(-30e-3, 30e-3, COUNT), np.zeros(COUNT), np.full(COUNT, 80e-3)], axis=1)
    assert found(ranged(points_m, rng, 1e-6), pixels(points_m, rng, 1e-6)) is None


def test_points_in_a_few_parts_have_no_covariance() -> None:
    rng = np.random.default_rng(8)
    points_m = scene(rng) * [0.15, 0.15, 1.0]
    assert found(ranged(points_m, rng), pixels(points_m, rng)) is None


def test_neighbours_are_displaced_beside_a_motion() -> None:
    rng = np.random.default_rng(9)
    squares = []
    shift_m = np.array([0.3e-3, -0.1e-3, 0.2e-3])
    for _ in range(150):
        points_m = scene(rng)[:12] * [0.2, 0.2, 1.0]
        answer = shift_between(ranged(points_m, rng), pixels(MOVE.apply(points_m) + shift_m, rng), CAMERAS, motion=MOVE)
        assert answer is not None
        found_m, covariance_m2 = answer
        miss = found_m - shift_m
        squares.append(miss @ np.linalg.solve(covariance_m2, miss))
    assert 0.93 <= np.mean(np.array(squares) <= 7.815) <= 1.0
    assert np.mean(squares) > 0.8


def test_neighbours_that_disagree_have_no_displacement() -> None:
    rng = np.random.default_rng(10)
    points_m = scene(rng)[:12] * [0.2, 0.2, 1.0]
    shifts = np.repeat([[1e-3, 0, 0], [-1e-3, 0, 0]], 6, axis=0)
    assert shift_between(ranged(points_m, rng), pixels(points_m + shifts, rng), CAMERAS, motion=at_rest()) is None
