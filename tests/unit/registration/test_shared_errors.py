"""Errors that all points of a registration share: against what a wrong value really does to the points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from markerseek.geometry import StereoCameras, triangulate
from markerseek.registration import PointPair, register_pairs
from markerseek.registration.shared_errors import camera_shared_m, focal_shared_m, trus_shared_m
from markerseek.sim import camera_above, endoscope

TRUS_M = np.array([[x, y, 60 + (x * y) % 7] for x in (-20, 0, 20) for y in (-20, 0, 20)]) * 1e-3
FACE_M = 10e-3
TRUE = camera_above(np.array([0.0, 0.0, 60e-3]), distance_m=0.1, roll_deg=40, tilt_deg=20)


def as_seen_with(sound_speed: float = 1.0, face_m: float = 0.0, zero_deg: float = 0.0) -> np.ndarray:
    """The markers, imaged with wrong values: depth from the face by the time, place by the angle."""
    angle = np.arctan2(TRUS_M[:, 0], TRUS_M[:, 2]) + np.radians(zero_deg)
    radius_m = FACE_M + face_m + sound_speed * (np.hypot(TRUS_M[:, 0], TRUS_M[:, 2]) - FACE_M)
    return np.stack([radius_m * np.sin(angle), TRUS_M[:, 1], radius_m * np.cos(angle)], axis=1)


@pytest.mark.parametrize(
    ("number", "wrong"), [(0, {"sound_speed": 1.01}), (1, {"face_m": 0.2e-3}), (2, {"zero_deg": 0.1})]
)
def test_a_wrong_value_of_the_probe_displaces_its_points_as_said(number: int, wrong: dict[str, float]) -> None:
    np.testing.assert_allclose(trus_shared_m(TRUS_M)[:, :, number], as_seen_with(**wrong) - TRUS_M, atol=2e-7)


def with_focal(cameras: StereoCameras, factor: float) -> StereoCameras:
    lens = structs.replace(cameras.left, focal_px=tuple(factor * each for each in cameras.left.focal_px))
    return replace(cameras, left=lens, right=lens)


def test_a_wrong_focal_length_displaces_the_camera_s_points_as_said() -> None:
    cameras = endoscope()
    left, right = cameras.project(TRUE.inverse().apply(TRUS_M))
    seen = triangulate(left, right, cameras, sigma_px=0.2)
    said = camera_shared_m(seen, left, right, cameras, calibration_sigma_px=0.2)
    moved = triangulate(left, right, with_focal(cameras, 1.005), sigma_px=0.2).points_m - seen.points_m
    np.testing.assert_allclose(said[:, :, 0], moved, atol=0.01e-3)
    np.testing.assert_allclose(said[:, :, 1:], 0.2 * seen.by_pixel_m)
    # Without pixels, the stretch in depth of a lens without distortion.
    np.testing.assert_allclose(focal_shared_m(seen.points_m)[:, :, 0], moved, atol=0.1e-3)


def pairs(trus_m: np.ndarray, *, cameras: StereoCameras) -> list[PointPair]:
    """Seen by cameras that are what `endoscope` says, read with other values."""
    left, right = endoscope().project(TRUE.inverse().apply(TRUS_M))
    seen = triangulate(left, right, cameras, sigma_px=0.2)
    shared = camera_shared_m(seen, left, right, cameras, calibration_sigma_px=0.2)
    return [
        PointPair(
            name=str(number),
            trus_m=trus_m[number],
            camera_m=seen.points_m[number],
            trus_covariance_m2=np.eye(3) * (0.05e-3) ** 2,
            camera_covariance_m2=seen.covariances_m2[number],
            camera_shared_m=shared[number],
        )
        for number in range(len(trus_m))
    ]


def test_a_sound_speed_off_by_one_per_cent_is_seen_and_the_expected_error_covers_it() -> None:
    """It made 0.8 mm where 0.1 mm was expected."""
    report = register_pairs(pairs(as_seen_with(sound_speed=1.01), cameras=endoscope()))
    assert report.registered
    speed = next(each for each in report.shared if each.name == "sound speed")
    assert (speed.name, speed.unit, speed.assumed_sigma) == ("sound speed", "%", 1.0)
    # The prior of 0 pulls at it.
    assert 0.6 < speed.value < 1.05
    # Base and focal length of the cameras change the size of the pattern, too.
    assert speed.sigma < 0.42
    matrix = np.array(report.davinci_to_trus)
    target_m = np.array(report.target_trus_m)
    # The target where the probe would see it, were its values right.
    off_m = matrix[:3, :3] @ TRUE.inverse().apply(target_m) + matrix[:3, 3] - target_m
    assert np.linalg.norm(off_m) < 0.25e-3
    assert np.linalg.norm(off_m) < report.tre95_m


def test_a_focal_length_that_no_point_shows_is_in_the_expected_error() -> None:
    report = register_pairs(pairs(TRUS_M, cameras=with_focal(endoscope(), 1.005)))
    focal = report.shared[0]
    assert (focal.name, focal.unit) == ("focal length", "%")
    assert focal.sigma > 0.8 * focal.assumed_sigma
    matrix = np.array(report.davinci_to_trus)
    target_m = np.array(report.target_trus_m)
    off_m = matrix[:3, :3] @ TRUE.inverse().apply(target_m) + matrix[:3, 3] - target_m
    assert 0.3e-3 < np.linalg.norm(off_m) < report.tre95_m


def test_what_a_larger_error_would_do_to_the_target_is_said_if_no_point_shows_it() -> None:
    right, wrong = (register_pairs(pairs(TRUS_M, cameras=with_focal(endoscope(), factor))) for factor in (1.0, 1.02))
    # Both fit, and the one says what the other is.
    assert right.registered
    assert wrong.registered
    moved_m = np.array(wrong.davinci_to_trus) - np.array(right.davinci_to_trus)
    target_m = np.array(right.target_trus_m)
    in_camera_m = np.linalg.solve(np.array(right.davinci_to_trus), [*target_m, 1.0])
    off_m = float(np.linalg.norm((moved_m @ in_camera_m)[:3]))
    assert off_m > 1.2e-3
    focal = right.shared[0]
    assert not focal.is_seen
    # 2 % are four standard deviations.
    assert 4 * focal.target_shift_m == pytest.approx(off_m, rel=0.1)
    assert right.assumed == (
        f"focal length right to 0.5 %, which these points do not show: 2 % would put the target "
        f"{4e3 * focal.target_shift_m:.1f} mm off"
    )
    speed = next(each for each in right.shared if each.name == "sound speed")
    assert speed.is_seen
