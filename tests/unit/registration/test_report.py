"""The report of a registration: when it is accepted, its file as others read it, its target in the images."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, RecordError
from markerseek.registration import (
    KnownRegistration,
    PointPair,
    RegistrationReport,
    StereoSettings,
    read_registration,
    register_pairs,
    target_pixels,
)
from markerseek.ros import messages
from markerseek.sim import endoscope
from tests.registration_sessions import CAMERA_M, registered

TRUS_M = np.array([[x, y, 60 + (x * y) % 7 / 2] for x in (-20, 0, 20) for y in (-20, 0, 20)]) * 1e-3
TURN = Rotation.from_euler("xyz", [150, 20, 40], degrees=True).as_matrix()
TRUS_SIGMA_M = np.array([0.1e-3, 0.03e-3, 0.05e-3])
CAMERA_SIGMA_M = np.array([0.02e-3, 0.02e-3, 0.5e-3])


def report(
    rng: np.random.Generator,
    *,
    count: int = 9,
    sigmas: bool = True,
    off_m: tuple[float, float, float] = (0, 0, 0),
    offset_m: float = 0.0,
) -> RegistrationReport:
    """Of points with the errors that their sigmas say, and sources beside their spots; the second is off."""
    pairs = []
    for number, point_m in enumerate(TRUS_M[[0, 2, 6, 8, 4, 1, 3, 5, 7][:count]], start=1):
        wrong_m = np.array(off_m) if number == 2 else 0.0
        pairs.append(
            PointPair(
                name=str(number),
                trus_m=point_m + np.hypot(TRUS_SIGMA_M, offset_m) * rng.standard_normal(3) + wrong_m,
                camera_m=(point_m - [0, 0, 0.15]) @ TURN + CAMERA_SIGMA_M * rng.standard_normal(3),
                trus_covariance_m2=np.diag(TRUS_SIGMA_M**2) if sigmas else None,
                camera_covariance_m2=np.diag(CAMERA_SIGMA_M**2) if sigmas else None,
            )
        )
    return register_pairs(pairs)


@pytest.mark.parametrize("count", [4, 9])
@pytest.mark.parametrize(("offset_m", "least", "most"), [(0.0, 0.98, 1), (0.3e-3, 0.97, 1), (2e-3, 0, 0.2)])
def test_points_are_accepted_whose_sources_lie_beside_their_spots_unless_they_are_far(
    count: int, offset_m: float, least: float, most: float
) -> None:
    rng = np.random.default_rng(count)
    share = np.mean([report(rng, count=count, offset_m=offset_m).registered for _ in range(60)])
    assert least <= share <= most


@pytest.mark.parametrize("offset_m", [0.1e-3, 0.3e-3, 0.6e-3])
def test_the_distance_between_spot_and_source_is_estimated(offset_m: float) -> None:
    rng = np.random.default_rng(1)
    said_m = [report(rng, offset_m=offset_m).offset_sigma_m for _ in range(20)]
    assert np.sqrt(np.mean(np.square(said_m))) == pytest.approx(offset_m, rel=0.3)


@pytest.mark.parametrize("off_m", [(3e-3, 0, 0), (0, 3e-3, 0), (0, 0, 3e-3)])
def test_a_point_that_is_3_mm_off_is_named_among_nine(off_m: tuple[float, float, float]) -> None:
    for seed in range(5):
        said = report(np.random.default_rng(seed), off_m=off_m)
        assert not said.registered
        assert said.worst == "2"
        assert "leave it out of the registration" in str(said.reason)


def test_where_several_points_may_be_the_wrong_one_all_are_named() -> None:
    """Any three of four corners fit where one is too high: a plane turns."""
    said = report(np.random.default_rng(2), count=4, off_m=(0, 0, 8e-3))
    assert not said.registered
    assert "but the others also fit without" in str(said.reason)


def test_without_sigmas_1_mm_is_assumed_of_each_coordinate() -> None:
    good = report(np.random.default_rng(1), sigmas=False)
    assert good.registered
    assert good.expected_fre_m == pytest.approx(1e-3 * np.sqrt(21 / 9))
    assert good.misfit == pytest.approx(9 * good.fre_m**2 / 1e-6 / 21)
    bad = report(np.random.default_rng(1), sigmas=False, off_m=(9e-3, 0, 0))
    assert not bad.registered
    assert "1 mm along each direction, which is assumed, lets expect (FRE 2." in str(bad.reason)
    assert "their sigmas" not in str(bad.reason)


def test_where_the_residuals_are_small_the_probability_of_a_wrong_point_is_the_reason() -> None:
    said = report(np.random.default_rng(1), off_m=(1.5e-3, 0, 0))
    assert not said.registered
    assert said.misfit < 1.5
    assert "as small as expected, but one point is wrong with a probability of 6" in str(said.reason)
    assert "agree better without 2;" in str(said.reason)


def test_points_of_which_none_can_be_left_out_are_refused_too() -> None:
    said = report(np.random.default_rng(1), count=3, off_m=(12e-3, 0, 0))
    assert not said.registered
    assert "and without it the others do not fit either" not in str(said.reason)


def read(folder: Path, **changes: Any) -> KnownRegistration:
    """What is read of the file of a registration by four markers, but for the changes."""
    path = folder / "registration.json"
    path.write_bytes(msgspec.json.encode(msgspec.to_builtins(registered(4).report) | changes))
    return read_registration(path)


def rotated(quaternion: SimpleNamespace, point: np.ndarray) -> np.ndarray:
    """A point turned by a quaternion, by its product: no matrix."""
    vector = np.array([quaternion.x, quaternion.y, quaternion.z])
    once = 2 * np.cross(vector, point)
    return point + quaternion.w * once + np.cross(vector, once)


@pytest.mark.parametrize(
    ("simulated", "child"), [(False, "davinci_camera_optical"), (True, "simulated_davinci_camera_optical")]
)
def test_ros_sends_it_in_metres_from_the_camera_to_the_home_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated: bool, child: str
) -> None:
    monkeypatch.setattr(messages, "kind", lambda _name: SimpleNamespace)
    held = read(tmp_path)
    message = messages.registered(held.davinci_to_trus, time_s=1.5, simulated=simulated)
    assert (message.header.frame_id, message.child_frame_id) == ("trus_home", child)
    place = message.transform.translation
    for camera_m in CAMERA_M:
        there_m = rotated(message.transform.rotation, camera_m) + np.array([place.x, place.y, place.z])
        np.testing.assert_allclose(there_m, held.davinci_to_trus.apply(camera_m), atol=1e-12)


SCALED = [[1.01, 0, 0, 0], [0, 1.01, 0, 0], [0, 0, 1.01, 0], [0, 0, 0, 1]]
MIRRORED = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"registered": False, "reason": "FRE of 9.00 mm"}, r"was not accepted \(FRE of 9.00 mm\); register again"),
        ({"davinci_to_trus": SCALED}, "off orthonormal"),
        ({"davinci_to_trus": MIRRORED}, "mirrors space"),
        ({"davinci_to_trus": [[1, 0, 0]] * 4}, "4 rows of 4 numbers"),
        (
            {"davinci_to_trus": [[1, 0, 0, None], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "registration as JSON is expected, and this is none",
        ),
    ],
)
def test_what_is_no_accepted_rigid_transform_is_refused(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(RecordError, match=said):
        read(tmp_path, **changed)


STEREO = StereoSettings.of(endoscope(), calibration_sigma_px=0.2)
SEEN_M = np.array([[-0.02, -0.02, 0.1], [0.02, -0.02, 0.1], [0.0, 0.02, 0.103], [0.005, -0.005, 0.11]])
MOVE_M = np.array([0.01, -0.03, -0.06])
SIGMA_M = 3e-4
TARGET_M = (0.01, -0.02, 0.045)


def pairs(rng: np.random.Generator) -> list[PointPair]:
    noise_m = SIGMA_M * rng.standard_normal((2, len(SEEN_M), 3))
    covariance = SIGMA_M**2 * np.eye(3)
    return [
        PointPair(
            name=str(number),
            camera_m=SEEN_M[number] + noise_m[0, number],
            trus_m=SEEN_M[number] + MOVE_M + noise_m[1, number],
            camera_covariance_m2=covariance,
            trus_covariance_m2=covariance,
            camera_shared_m=np.zeros((3, 0)),
        )
        for number in range(len(SEEN_M))
    ]


def test_the_ellipse_holds_95_percent_of_the_pixels_of_the_target() -> None:
    rng = np.random.default_rng(4)
    true_left = np.array(TARGET_M) - MOVE_M
    true_px = STEREO.cameras.project(true_left[None])
    inside = np.zeros(2)
    count = 40
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


def test_what_cannot_be_seen_is_said() -> None:
    rng = np.random.default_rng(2)
    behind = register_pairs(pairs(rng), target_trus_m=(0.0, 0.0, -0.3))
    with pytest.raises(ConfigError, match="behind the left camera; name another by `target_trus_m`"):
        target_pixels(behind, stereo=STEREO)
    points = pairs(rng)
    points[3] = replace(points[3], trus_m=points[3].trus_m + 0.02)
    skewed = register_pairs(points)
    with pytest.raises(ConfigError, match="the points do not fit"):
        target_pixels(skewed, stereo=STEREO)
