"""The target of a registration in the images of both cameras, against many simulated registrations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.geometry import Camera
from markerseek.registration import PointPair, read_stereo, register_pairs, target_pixels

STEREO = read_stereo([Path(__file__).parents[3] / "examples" / "stereo.toml"], calibration_sigma_px=None)
CAMERA_M = np.array([[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.0, 0.02, 0.103], [0.005, -0.005, 0.11]])
MOVE_M = np.array([0.01, -0.03, -0.06])
SIGMA_M = 3e-4
TARGET_M = (0.01, -0.02, 0.045)


def pairs(rng: np.random.Generator, camera_m: np.ndarray = CAMERA_M) -> list[PointPair]:
    noise_m = SIGMA_M * rng.standard_normal((2, len(camera_m), 3))
    covariance = SIGMA_M**2 * np.eye(3)
    return [
        PointPair(
            name=str(number),
            camera_m=camera_m[number] + noise_m[0, number],
            trus_m=camera_m[number] + MOVE_M + noise_m[1, number],
            camera_covariance_m2=covariance,
            trus_covariance_m2=covariance,
            camera_shared_m=np.zeros((3, 0)),
        )
        for number in range(len(camera_m))
    ]


def test_the_ellipse_holds_95_percent_of_the_pixels_of_the_target() -> None:
    rng = np.random.default_rng(4)
    true_left = np.array(TARGET_M) - MOVE_M
    true_px = STEREO.cameras.project(true_left[None])
    inside, count = np.zeros(2), 40
    for _ in range(count):
        report = register_pairs(pairs(rng), target_trus_m=TARGET_M)
        for side, (seen, true) in enumerate(zip(target_pixels(report, stereo=STEREO), true_px, strict=True)):
            pixel, covariance_px2 = seen
            away = pixel - true[0]
            inside[side] += away @ np.linalg.solve(covariance_px2, away) <= 5.991
    # 95 % of 40 are 38.0 +- 1.4; it is scaled up where the residuals are large by chance.
    assert (inside >= 34).all()
    # The ellipse is that of the registration and not as wide as the image: half a millimetre at 0.1 m.
    assert 1.0 < np.sqrt(np.trace(covariance_px2)) < 30.0


def test_a_covariance_is_projected_as_many_points_are() -> None:
    camera = Camera(
        focal_px=(900.0, 880.0), centre_px=(500.0, 400.0), size_px=(1024, 768), distortion=(-0.2, 0.1, 1e-3, -2e-3, 0.0)
    )
    rng = np.random.default_rng(1)
    spread = rng.standard_normal((3, 3)) * 2e-4
    point_m = np.array([0.02, -0.015, 0.09])
    cloud = camera.project(point_m + rng.standard_normal((200_000, 3)) @ spread.T)
    found = camera.project_covariance(point_m, spread @ spread.T)
    np.testing.assert_allclose(found, np.cov(cloud.T), rtol=0.03, atol=0.02)


def test_what_cannot_be_seen_is_said() -> None:
    rng = np.random.default_rng(2)
    behind = register_pairs(pairs(rng), target_trus_m=(0.0, 0.0, -0.3))
    with pytest.raises(ConfigError, match="behind the left camera; name another by --target-mm"):
        target_pixels(behind, stereo=STEREO)
    points = pairs(rng)
    points[3] = replace(points[3], trus_m=points[3].trus_m + 0.02)
    skewed = register_pairs(points)
    with pytest.raises(ConfigError, match="the points do not fit"):
        target_pixels(skewed, stereo=STEREO)
