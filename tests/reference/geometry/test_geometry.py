"""Registration and stereo cameras against SciPy, OpenCV, a closed form and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from markerseek.core import ConfigError
from markerseek.geometry import (
    Camera,
    Registration,
    RegistrationErrors,
    RigidTransform,
    StereoCameras,
    best_rotation,
    mirror_image_fre,
    register_points,
    triangulate,
)
from markerseek.geometry.registration import effect_of_motion
from markerseek.sim.stereo_endoscope import endoscope

GRID_M = np.array([[x, y, 60.0] for x in (-20, 0, 20) for y in (-20, 0, 20)]) * 1e-3
RELIEF_M = np.array([1.0, -2.2, 2.4, 0.3, -1.7, 0.9, -2.4, 2.0, -0.4]) * 1e-3
POINTS_M = GRID_M + RELIEF_M[:, None] * [0, 0, 1]
TARGET_M = np.array([0.0, 0.0, 40e-3])


def some_transform(seed: int) -> RigidTransform:
    rng = np.random.default_rng(seed)
    return RigidTransform(
        source="DaVinci",
        target="ProbeHome",
        rotation=Rotation.random(rng=rng).as_matrix(),
        translation_m=rng.uniform(-0.2, 0.2, 3),
    )


@given(seed=st.integers(0, 10_000), count=st.integers(3, 12))
def test_horn_is_scipy_s_rotation(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(count, 3))
    target = rng.normal(size=(count, 3))
    weights = rng.uniform(0.1, 5, count)
    rotation, translation = best_rotation(source, target, weights)
    middle = [np.average(points, axis=0, weights=weights) for points in (source, target)]
    expected, rssd = Rotation.align_vectors(target - middle[1], source - middle[0], weights=weights)
    residual = source @ rotation.T + translation - target
    np.testing.assert_allclose(np.sqrt(weights @ np.sum(residual**2, axis=1)), rssd, rtol=1e-9)
    # Random points fit two rotations equally well now and then; the residual above is what counts.
    if np.linalg.svd((source - middle[0]).T @ np.diag(weights) @ (target - middle[1]), compute_uv=False)[-1] > 0.05:
        np.testing.assert_allclose(rotation, expected.as_matrix(), atol=1e-7)


def test_equal_errors_give_fitzpatrick_s_closed_form() -> None:
    sigma = 0.4e-3
    covariances = np.tile(np.eye(3) * sigma**2, (9, 1, 1))
    found = register_points(POINTS_M, POINTS_M, target_covariances_m2=covariances, source="A", target="B")
    fle_squared = 3 * sigma**2
    assert found.errors.fre_m**2 == pytest.approx((1 - 2 / 9) * fle_squared, rel=1e-9)
    # Fitzpatrick 1998: TRE² = FLE²/N (1 + 1/3 Σ d²/f²) over the principal axes.
    apart = POINTS_M - POINTS_M.mean(axis=0)
    axes = np.linalg.svd(apart)[2]
    inside = apart @ axes.T
    target = axes @ (TARGET_M - POINTS_M.mean(axis=0))
    terms = [
        (np.sum(target**2) - target[k] ** 2) / np.mean(np.sum(inside**2, axis=1) - inside[:, k] ** 2) for k in range(3)
    ]
    assert found.errors.tre_m(TARGET_M) ** 2 == pytest.approx(fle_squared / 9 * (1 + sum(terms) / 3), rel=1e-9)


def require_predicted(
    found: list[Registration], predicted: RegistrationErrors, true: RigidTransform, *, fre: float, tre: float
) -> np.ndarray:
    """FRE and TRE of many registrations are as predicted, to these accuracies; returns the errors at the target."""
    off_m = np.array([each.transform.apply(true.inverse().apply(TARGET_M)) - TARGET_M for each in found])
    assert np.sqrt(np.mean([each.fre_m**2 for each in found])) == pytest.approx(predicted.fre_m, rel=fre)
    assert np.sqrt(np.mean(np.sum(off_m**2, axis=1))) == pytest.approx(predicted.tre_m(TARGET_M), rel=tre)
    return np.linalg.norm(off_m, axis=1)


@pytest.mark.long
@pytest.mark.parametrize(("refined", "count"), [(False, 9), (True, 3), (True, 9)])
def test_predicted_errors_are_those_of_many_registrations(refined: bool, count: int) -> None:
    """FRE and TRE within 3 %, for errors that differ in direction and from point to point."""
    rng = np.random.default_rng(count)
    true = some_transform(1)
    target = POINTS_M[[0, 2, 7, 8, 3, 5, 1, 4, 6][:count]]
    source = true.inverse().apply(target)
    # A camera's covariance, long in depth, in a frame turned against that of the probe.
    long = [rng.uniform(0.01, 0.02, 3) * 1e-3 * [1, 1, 12] for _ in range(count)]
    turns = Rotation.random(count, rng=rng).as_matrix()
    from_source = np.array([t @ np.diag(s**2) @ t.T for t, s in zip(turns, long, strict=True)])
    from_target = np.array([np.diag((rng.uniform(0.02, 0.05, 3) * 1e-3) ** 2) for _ in range(count)])
    known = {"source_covariances_m2": from_source, "target_covariances_m2": from_target, "refined": refined}
    roots = [np.linalg.cholesky(covariances) for covariances in (from_source, from_target)]
    found = []
    for _ in range(1000):
        draws = [np.einsum("nij,nj->ni", root, rng.standard_normal((count, 3))) for root in roots]
        found.append(register_points(source + draws[0], target + draws[1], **known))
    require_predicted(found, register_points(source, target, **known).errors, true, fre=0.03, tre=0.03)
    if refined:
        assert np.mean([each.misfit for each in found]) == pytest.approx(1.0, rel=0.03)


def shared_errors(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Errors that all points share: a camera's depth is stretched and shifted, an ultrasound's depth stretched."""
    depth_m = np.tile([0.0, 0.0, 1.0], (9, 1))
    return (
        np.stack([0.4e-3 * depth_m, rng.normal(scale=0.05e-3, size=(9, 3))], axis=2),
        np.stack([0.01 * POINTS_M * [1, 0, 1], 0.1e-3 * np.eye(3)[[1] * 9]], axis=2),
    )


@pytest.mark.long
@pytest.mark.parametrize("refined", [False, True])
def test_predicted_errors_hold_where_all_points_share_errors(refined: bool) -> None:
    """FRE and TRE are those of many registrations that draw these errors from their priors; 95 % are covered."""
    rng = np.random.default_rng(8)
    true = some_transform(2)
    source = true.inverse().apply(POINTS_M)
    source_shared, target_shared = shared_errors(rng)
    long_m = np.array([0.02e-3, 0.02e-3, 0.5e-3])
    even_m = 0.04e-3
    known = {
        "source_covariances_m2": np.tile(np.diag(long_m**2), (9, 1, 1)),
        "target_covariances_m2": np.tile(np.eye(3) * even_m**2, (9, 1, 1)),
        "source_shared_m": source_shared,
        "target_shared_m": target_shared,
        "refined": refined,
    }
    predicted = register_points(source, POINTS_M, **known).errors
    found = []
    drawn = rng.standard_normal((800, 4))
    for each in drawn:
        source_m = source + source_shared @ each[:2] + rng.normal(size=(9, 3)) * long_m
        target_m = POINTS_M + target_shared @ each[2:] + rng.normal(size=(9, 3)) * even_m
        found.append(register_points(source_m, target_m, **known))
    # 800 registrations know a root mean square to 2.5 % where one error prevails.
    off_m = require_predicted(found, predicted, true, fre=0.05, tre=0.06)
    assert np.mean(off_m < predicted.tre95_m(TARGET_M)) == pytest.approx(0.95, abs=0.02)
    if refined:
        assert np.mean([each.misfit for each in found]) == pytest.approx(1.0, rel=0.03)
        sigmas = [np.sqrt(np.diag(each.errors.covariance)[6:]) for each in found]
        pulls = (np.array([each.shared for each in found]) - drawn) / sigmas
        np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=0.08)


def test_a_frame_registered_to_itself_has_no_error() -> None:
    points_m = 1e-3 * np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0], [0.0, 0.0, 30.0]])
    found = register_points(points_m, points_m)
    assert found.fre_m == found.tre_m(TARGET_M) == found.tre95_m(TARGET_M) == 0.0


@pytest.mark.parametrize("variances", [(1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 0.5, 0.1), (1.0, 0.3, 0.0)])
def test_the_length_that_95_of_100_errors_stay_below(variances: tuple[float, float, float]) -> None:
    covariance = np.zeros((6, 6))
    covariance[3:, 3:] = 1e-6 * np.diag(variances)
    errors = RegistrationErrors(covariances=covariance[None], weights=np.ones(1), middle_m=np.zeros(3), fre_m=0.0)
    drawn_m = np.random.default_rng(1).normal(size=(200_000, 3)) * 1e-3 * np.sqrt(variances)
    share = np.mean(np.linalg.norm(drawn_m, axis=1) < errors.tre95_m(np.zeros(3)))
    assert share == pytest.approx(0.95, abs=0.003)


def test_the_length_of_a_mixture_is_the_quantile_of_draws_from_it() -> None:
    covariances = np.zeros((2, 6, 6))
    covariances[0, 3:, 3:] = 1e-6 * np.diag([1.0, 0.3, 0.1])
    covariances[1, 3:, 3:] = 1e-6 * np.diag([9.0, 9.0, 4.0])
    weights = np.array([0.8, 0.2])
    errors = RegistrationErrors(covariances=covariances, weights=weights, middle_m=np.zeros(3), fre_m=0.0)
    rng = np.random.default_rng(1)
    parts = rng.choice(2, size=200_000, p=weights)
    drawn_m = rng.normal(size=(200_000, 3)) * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)[parts, 3:])
    share = np.mean(np.linalg.norm(drawn_m, axis=1) < errors.tre95_m(np.zeros(3)))
    assert share == pytest.approx(0.95, abs=0.004)
    assert errors.tre_m(np.zeros(3)) == pytest.approx(np.sqrt(np.mean(np.sum(drawn_m**2, axis=1))), rel=0.01)


def test_an_offset_of_unknown_size_is_summed_over_as_dense_gaussians_say() -> None:
    """Residuals marginalised over transform, shared errors and offset: one Gaussian a size, without any block form."""
    rng = np.random.default_rng(4)
    covariances = np.tile(np.diag([0.05e-3, 0.04e-3, 0.4e-3]) ** 2, (5, 1, 1))
    shared_m = 0.3e-3 * rng.standard_normal((5, 3, 2))
    target_m = POINTS_M[:5] + 0.3e-3 * rng.standard_normal((5, 3))
    doubtful = np.array([[1.0, 0.0]])
    found = register_points(
        POINTS_M[:5],
        target_m,
        target_covariances_m2=covariances,
        target_shared_m=shared_m,
        offset_sigma_m=0.2e-3,
        doubtful=doubtful,
    )
    # About the transform that was found: residuals are linear in what is left of it, which may be anything.
    middle_m = target_m.mean(axis=0)
    motion = effect_of_motion(target_m - middle_m).reshape(15, 6)
    flat = np.linalg.svd(motion)[0][:, 6:]
    residuals = found.residuals_m.ravel() @ flat
    logs = []
    sizes = np.linspace(-3.0, 3.5, 14)
    prior = np.exp(-(sizes**2) / 2)
    prior /= prior.sum()
    for size, share in zip(sizes, prior, strict=True):
        offset_m2 = (0.2e-3 * (3.0 if size < 0 else 1.7) ** size) ** 2
        for wider, probability in ((1.0, 0.95), (4.0, 0.05)):
            columns = shared_m.reshape(15, 2) * [wider, 1.0]
            dense = block_diag(*covariances) + offset_m2 * np.eye(15) + columns @ columns.T
            spread = flat.T @ dense @ flat
            log = multivariate_normal.logpdf(residuals, cov=spread)
            # The density of residuals across the directions of the motion, whose volume is that of its columns.
            logs.append(log + np.log(share * probability) - np.linalg.slogdet(motion.T @ motion)[1] / 2)
    assert found.log_evidence == pytest.approx(logsumexp(logs), abs=0.1)
    larger = np.exp(logsumexp(logs[1::2]) - logsumexp(logs))
    assert found.doubts[0].probability == pytest.approx(larger, rel=0.1)


@pytest.mark.parametrize("seed", range(3))
def test_shared_errors_are_estimated_as_a_general_optimiser_finds_them(seed: int) -> None:
    """Over the transform, the true points and the shared errors with their priors, as in a bundle adjustment."""
    rng = np.random.default_rng(seed)
    true = some_transform(seed)
    source_shared, target_shared = shared_errors(rng)
    long_m = np.array([0.02e-3, 0.02e-3, 0.5e-3])
    even_m = 0.05e-3
    drawn = rng.normal(scale=2, size=4)
    source = true.inverse().apply(POINTS_M) + source_shared @ drawn[:2] + rng.normal(size=(9, 3)) * long_m
    target = POINTS_M + target_shared @ drawn[2:] + rng.normal(scale=even_m, size=(9, 3))
    found = register_points(
        source,
        target,
        source_covariances_m2=np.tile(np.diag(long_m**2), (9, 1, 1)),
        target_covariances_m2=np.tile(np.eye(3) * even_m**2, (9, 1, 1)),
        source_shared_m=source_shared,
        target_shared_m=target_shared,
    )

    def residual(parameters: np.ndarray) -> np.ndarray:
        turn = Rotation.from_rotvec(parameters[:3])
        shared = parameters[6:10]
        points = 1e-3 * parameters[10:].reshape(9, 3)
        seen = turn.inv().apply(points - 1e-3 * parameters[3:6])
        in_source = (seen + source_shared @ shared[:2] - source) / long_m
        in_target = (points + target_shared @ shared[2:] - target) / even_m
        return np.concatenate([in_source.ravel(), in_target.ravel(), shared])

    start = [*Rotation.from_matrix(true.rotation).as_rotvec(), *(1e3 * true.translation_m), *drawn]
    best = least_squares(residual, [*start, *(1e3 * target.ravel())], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert 2 * best.cost == pytest.approx(found.misfit * 21, rel=1e-6)
    np.testing.assert_allclose(best.x[6:10], found.shared, atol=2e-4)
    np.testing.assert_allclose(1e-3 * best.x[3:6], found.transform.translation_m, atol=2e-6)
    # Its curvature is the inverse of the covariance that is said.
    covariance = np.linalg.inv(best.jac.T @ best.jac)[6:10, 6:10]
    np.testing.assert_allclose(np.diag(found.errors.covariance)[6:], np.diag(covariance), rtol=0.02)


def test_the_refinement_ends_also_with_wrong_pairs_and_three_far_points() -> None:
    rng = np.random.default_rng(1)
    long = np.tile(np.diag([0.02e-3, 0.02e-3, 2e-3]) ** 2, (9, 1, 1))
    for seed in range(30):
        source = some_transform(seed).inverse().apply(POINTS_M) + rng.normal(size=(9, 3)) * [0.02e-3, 0.02e-3, 2e-3]
        for target, count in ((rng.permutation(POINTS_M), 9), (POINTS_M, 3)):
            found = register_points(
                source[[0, 2, 7, 1, 3, 4, 5, 6, 8]][:count],
                target[[0, 2, 7, 1, 3, 4, 5, 6, 8]][:count],
                source_covariances_m2=long[:count],
                target_covariances_m2=np.tile(np.eye(3) * 0.05e-3**2, (count, 1, 1)),
            )
            assert np.isfinite(found.transform.matrix).all()
            assert np.isfinite(found.misfit)


def test_without_sigmas_the_residuals_say_how_large_the_errors_are() -> None:
    rng = np.random.default_rng(3)
    off = []
    said = []
    for _ in range(1500):
        found = register_points(POINTS_M + rng.normal(scale=0.3e-3, size=(9, 3)), POINTS_M)
        off.append(np.sum((found.transform.apply(TARGET_M) - TARGET_M) ** 2))
        said.append(found.tre_m(TARGET_M) ** 2)
    assert np.mean(said) == pytest.approx(np.mean(off), rel=0.08)


def test_residuals_beyond_the_sigmas_scale_the_error() -> None:
    rng = np.random.default_rng(3)
    noisy = POINTS_M + rng.normal(scale=1e-3, size=(9, 3))
    small = np.tile(np.eye(3) * 0.1e-3**2, (9, 1, 1))
    found = register_points(noisy, POINTS_M, source_covariances_m2=small)
    honest = register_points(noisy, POINTS_M)
    assert found.misfit > 30
    assert found.tre_m(TARGET_M) == pytest.approx(honest.tre_m(TARGET_M), rel=1e-3)


def test_a_mirror_image_fits_mirrored_points_and_planes() -> None:
    mirrored = POINTS_M * [-1, 1, 1]
    assert mirror_image_fre(mirrored, POINTS_M) == pytest.approx(0, abs=1e-9)
    assert register_points(mirrored, POINTS_M).fre_m > 1e-3
    flat = GRID_M @ some_transform(4).rotation.T
    assert mirror_image_fre(flat, GRID_M) == pytest.approx(register_points(flat, GRID_M).fre_m, abs=1e-9)


LENS = Camera(
    focal_px=(1100.0, 1095.0),
    centre_px=(645.0, 508.0),
    size_px=(1280, 1024),
    distortion=(-0.32, 0.14, 0.001, -0.0007, -0.02),
)
CAMERAS = StereoCameras(
    left=LENS,
    right=Camera(
        focal_px=(1103.0, 1099.0), centre_px=(630.0, 515.0), size_px=(1280, 1024), distortion=(-0.3, 0.1, 0, 0.0005, 0)
    ),
    left_to_right=RigidTransform(
        source="Left",
        target="Right",
        rotation=Rotation.from_rotvec([0.004, -0.01, 0.002]).as_matrix(),
        translation_m=np.array([-5e-3, 0.1e-3, -0.05e-3]),
    ),
)


def seen_points(seed: int, count: int = 40) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack(
        [rng.uniform(-40e-3, 40e-3, count), rng.uniform(-30e-3, 30e-3, count), rng.uniform(0.09, 0.15, count)], axis=1
    )


def opencv_matrix(camera: Camera) -> np.ndarray:
    (fx, fy) = camera.focal_px
    (cx, cy) = camera.centre_px
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def test_projection_and_its_inverse_are_opencv_s() -> None:
    cv2 = pytest.importorskip("cv2")
    points = seen_points(0)
    for camera in (CAMERAS.left, CAMERAS.right):
        expected, _ = cv2.projectPoints(
            points, np.zeros(3), np.zeros(3), opencv_matrix(camera), np.array(camera.distortion)
        )
        pixels = camera.project(points)
        np.testing.assert_allclose(pixels, expected[:, 0], atol=1e-6)
        np.testing.assert_allclose(camera.undistort(pixels), points[:, :2] / points[:, 2:], atol=1e-10)


def test_a_covariance_is_projected_as_many_points_are() -> None:
    rng = np.random.default_rng(1)
    spread = rng.standard_normal((3, 3)) * 2e-4
    point_m = np.array([0.02, -0.015, 0.09])
    cloud = LENS.project(point_m + rng.standard_normal((200_000, 3)) @ spread.T)
    found = LENS.project_covariance(point_m, spread @ spread.T)
    np.testing.assert_allclose(found, np.cov(cloud.T), rtol=0.03, atol=0.02)


@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_triangulation_is_opencv_s(noise_px: float) -> None:
    cv2 = pytest.importorskip("cv2")
    points = seen_points(1)
    rng = np.random.default_rng(2)
    left, right = (pixels + rng.normal(scale=noise_px, size=pixels.shape) for pixels in CAMERAS.project(points))
    found = triangulate(left, right, CAMERAS, sigma_px=0.3)
    direct = [
        cv2.undistortPoints(
            pixels[:, None],
            opencv_matrix(camera),
            np.array(camera.distortion),
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12),
        )[:, 0].T
        for pixels, camera in ((left, CAMERAS.left), (right, CAMERAS.right))
    ]
    first = np.eye(4)[:3]
    second = CAMERAS.left_to_right.matrix[:3]
    homogeneous = cv2.triangulatePoints(first, second, *direct)
    expected = (homogeneous[:3] / homogeneous[3]).T
    # With noise OpenCV's linear method minimises another error: it differs by a small part of the noise.
    sigma = np.sqrt(np.trace(found.covariances_m2, axis1=1, axis2=2))
    assert np.abs(found.points_m - expected).max() < (1e-8 if noise_px == 0 else 0.2 * sigma.max())


def test_the_covariance_of_a_point_is_that_of_many() -> None:
    points = seen_points(3, 6)
    rng = np.random.default_rng(4)
    left, right = CAMERAS.project(points)
    predicted = triangulate(left, right, CAMERAS, sigma_px=0.2).covariances_m2
    runs = 4000
    many = [np.repeat(pixels, runs, axis=0) + rng.normal(scale=0.2, size=(6 * runs, 2)) for pixels in (left, right)]
    found = triangulate(*many, CAMERAS, sigma_px=0.2)
    off = found.points_m.reshape(6, runs, 3) - points[:, None]
    covariances = np.einsum("nri,nrj->nij", off, off) / runs
    np.testing.assert_allclose(
        np.sqrt(np.trace(covariances, axis1=1, axis2=2)), np.sqrt(np.trace(predicted, axis1=1, axis2=2)), rtol=0.03
    )
    for ours, theirs in zip(predicted, covariances, strict=True):
        # The whole ellipsoid and not its size only: predicted whitening makes the sample covariance the identity.
        root = np.linalg.inv(np.linalg.cholesky(ours))
        np.testing.assert_allclose(root @ theirs @ root.T, np.eye(3), atol=0.08)


def test_a_shift_of_the_pixels_moves_the_points_as_said() -> None:
    left, right = CAMERAS.project(seen_points(6, 8))
    found = triangulate(left, right, CAMERAS, sigma_px=0.2)
    for pixel in range(4):
        shift = 1e-3 * np.eye(4)[pixel]
        moved = triangulate(left + shift[:2], right + shift[2:], CAMERAS, sigma_px=0.2).points_m - found.points_m
        np.testing.assert_allclose(moved, 1e-3 * found.by_pixel_m[:, :, pixel], atol=2e-9)


def test_different_spots_in_the_two_images_are_refused() -> None:
    left, right = CAMERAS.project(seen_points(5, 4))
    with pytest.raises(ConfigError, match=r"point 3: its two lines of sight miss each other by .* different spots"):
        triangulate(left, right + np.array([[0, 0], [0, 0], [0, 12], [0, 0]]), CAMERAS, sigma_px=0.2)
    with pytest.raises(ConfigError, match=r"pixel 1 is \(-20\.0, 30\.0\), outside the image"):
        triangulate(np.array([[-20.0, 30.0]]), np.array([[20.0, 30.0]]), CAMERAS, sigma_px=0.2)


@pytest.mark.parametrize(
    ("turned_left", "turned_right", "exchanged", "cause"),
    [
        (False, False, True, "the two images are exchanged"),
        (True, True, False, "both images are turned by 180 deg"),
        (True, False, False, "the left image is turned by 180 deg"),
        (False, True, False, "the right image is turned by 180 deg"),
    ],
)
def test_images_that_are_exchanged_or_turned_are_named_with_what_else_would_fit(
    turned_left: bool, turned_right: bool, exchanged: bool, cause: str
) -> None:
    left, right = CAMERAS.project(seen_points(5, 6))
    if turned_left:
        left = np.subtract(CAMERAS.left.size_px, 1) - left
    if turned_right:
        right = np.subtract(CAMERAS.right.size_px, 1) - right
    if exchanged:
        left, right = right, left
    with pytest.raises(ConfigError, match=rf"point \d: .*; it would fit if .*{cause}.*: compare both images with"):
        triangulate(left, right, CAMERAS, sigma_px=0.2)


def test_parallel_cameras_cannot_tell_exchanged_images_from_turned_ones_and_both_are_named() -> None:
    camera = Camera(focal_px=(900.0, 900.0), centre_px=(639.5, 511.5), size_px=(1280, 1024))
    cameras = StereoCameras(
        left=camera,
        right=camera,
        left_to_right=RigidTransform(
            source="left", target="right", rotation=np.eye(3), translation_m=np.array([-5e-3, 0.0, 0.0])
        ),
    )
    left, right = cameras.project(np.array([[0.004, -0.002, 0.09]]))
    with pytest.raises(
        ConfigError,
        match="meet behind the cameras; it would fit if the two images are exchanged, or if both images are turned",
    ):
        triangulate(right, left, cameras, sigma_px=0.2)
    # Exchanged as well as turned they fit: then only a look at the images tells.
    last_px = np.array([1279.0, 1023.0])
    turned = triangulate(last_px - right, last_px - left, cameras, sigma_px=1.0)
    assert turned.points_m[0, 2] == pytest.approx(0.09)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (POINTS_M[:2], "2 points in DaVinci, it must be 3 to 1000 that are not on a line"),
        (POINTS_M[[0, 0, 8]], "lie on a line: their width is .* add a point beside the line"),
        (GRID_M[[0, 1, 2]], "lie on a line"),
        (np.repeat(POINTS_M[:1], 4, axis=0), "lie on a line"),
        (
            np.where(np.arange(27).reshape(9, 3) == 4, np.nan, POINTS_M),
            "point 2 in DaVinci has a coordinate",
        ),
    ],
    ids=["two points", "twice the same", "on a line", "all the same", "NaN"],
)
def test_points_that_determine_nothing_are_refused(points: np.ndarray, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        register_points(points, points.copy())


def test_a_sigma_of_0_is_refused() -> None:
    covariances = np.tile(np.eye(3) * 1e-8, (9, 1, 1))
    covariances[4, 2, 2] = 0.0
    with pytest.raises(ConfigError, match="point 5 has a sigma of 0"):
        register_points(POINTS_M, POINTS_M.copy(), source_covariances_m2=covariances)


def test_transforms_are_rotations_and_meet_in_named_frames() -> None:
    first = some_transform(1)
    back = some_transform(1).inverse()
    assert (first.name, back.name) == ("DaVinciToProbeHome", "ProbeHomeToDaVinci")
    np.testing.assert_allclose((back @ first).matrix, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(back.apply(first.apply(POINTS_M)), POINTS_M, atol=1e-12)
    with pytest.raises(ConfigError, match="DaVinciToProbeHome after DaVinciToProbeHome: the first ends in ProbeHome"):
        first @ first
    for wrong, words in (
        (-np.eye(3), "mirrors space"),
        (1.01 * np.eye(3), "orthonormal"),
        (np.nan * np.eye(3), "not f"),
    ):
        with pytest.raises(ConfigError, match=words):
            RigidTransform(source="A", target="B", rotation=wrong, translation_m=np.zeros(3))


def test_pairs_of_cameras_that_stand_otherwise_are_not_equal() -> None:
    assert endoscope(base_m=5e-3) != endoscope(base_m=10e-3)
