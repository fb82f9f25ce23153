"""Real pictures of a da Vinci endoscope: a chessboard at several places before a background that stands still.

The pictures are not in the repository; their folder is `MARKERSEEK_REAL_ENDOSCOPE`.
"""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import StereoPair
from markerseek.geometry import Camera, RigidTransform, StereoCameras
from markerseek.vision import NotKnown, SceneFollower, SceneSeen, SceneTexture, brightness, scene_texture

FOLDER = Path(os.environ.get("MARKERSEEK_REAL_ENDOSCOPE", Path(__file__).parents[4] / "shared/data/endoscope"))
NUMBERS = ("01", "02", "05", "14", "18")
CORNERS = (9, 6)
SQUARE_M = 11.96e-3

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no real pictures of an endoscope in {FOLDER}")


def corners(side: str, number: str) -> np.ndarray:
    image = cv2.cvtColor(cv2.imread(str(FOLDER / f"{side}-{number}.png")), cv2.COLOR_BGR2GRAY)
    found, places = cv2.findChessboardCorners(image, CORNERS)
    assert found
    return cv2.cornerSubPix(image, places, (5, 5), (-1, -1), (3, 40, 1e-3)).reshape(-1, 2)


def board_m() -> np.ndarray:
    board = np.zeros((CORNERS[0] * CORNERS[1], 3), np.float32)
    board[:, :2] = np.mgrid[0 : CORNERS[0], 0 : CORNERS[1]].T.reshape(-1, 2) * SQUARE_M
    return board


@pytest.fixture(scope="module")
def cameras() -> StereoCameras:
    """The calibration by the corners of all pairs, with OpenCV."""
    boards = [board_m()] * len(NUMBERS)
    left, right = ([corners(side, number) for number in NUMBERS] for side in ("left", "right"))
    size = (640, 480)
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    lenses = [cv2.calibrateCamera(boards, each, size, None, None, flags=flags)[1:3] for each in (left, right)]
    stereo = cv2.stereoCalibrate(boards, left, right, *lenses[0], *lenses[1], size, flags=cv2.CALIB_FIX_INTRINSIC)
    one, other = (
        Camera(
            focal_px=(matrix[0, 0], matrix[1, 1]),
            centre_px=(matrix[0, 2], matrix[1, 2]),
            size_px=size,
            distortion=tuple(bend.ravel()[:5].tolist()),
        )
        for matrix, bend in lenses
    )
    return StereoCameras(
        left=one,
        right=other,
        left_to_right=RigidTransform(
            source="Left", target="Right", rotation=stereo[5], translation_m=stereo[6].ravel()
        ),
    )


def pair(number: str) -> StereoPair:
    left, right = (brightness(cv2.imread(str(FOLDER / f"{side}-{number}.png"))) for side in ("left", "right"))
    return StereoPair(left=left, right=right, at_s=float(number))


def pose(number: str, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and translation of the board by its corners."""
    (fx, fy) = camera.focal_px
    (cx, cy) = camera.centre_px
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    _, turn, shift = cv2.solvePnP(board_m(), corners("left", number), matrix, np.array(camera.distortion))
    return cv2.Rodrigues(turn)[0], shift.ravel()


def follow(cameras: StereoCameras, first: str, second: str) -> SceneSeen | NotKnown:
    texture = scene_texture(pair(first), cameras)
    assert isinstance(texture, SceneTexture)
    return SceneFollower(texture, rng=np.random.default_rng(1)).follow(pair(second))


@pytest.mark.parametrize("number", NUMBERS)
def test_the_same_picture_twice_is_at_rest(cameras: StereoCameras, number: str) -> None:
    seen = follow(cameras, number, number)
    assert isinstance(seen, SceneSeen)
    assert not isinstance(seen.motion, NotKnown)
    np.testing.assert_allclose(seen.motion.transform.matrix, np.eye(4), atol=1e-9)


@pytest.mark.parametrize(("first", "second"), list(itertools.permutations(NUMBERS, 2)))
def test_a_board_before_a_background_moves_as_its_corners_or_is_not_known(
    cameras: StereoCameras, first: str, second: str
) -> None:
    seen = follow(cameras, first, second)
    if isinstance(seen, NotKnown) or isinstance(seen.motion, NotKnown):
        return
    (from_turn, from_m), (to_turn, to_m) = (pose(each, cameras.left) for each in (first, second))
    turn = to_turn @ from_turn.T
    middle_m = from_turn @ board_m().mean(axis=0) + from_m
    there_m = turn @ (middle_m - from_m) + to_m
    transform = seen.motion.transform
    assert np.linalg.norm(transform.apply(middle_m) - there_m) < 0.5e-3
    assert np.degrees(Rotation.from_matrix(turn @ transform.rotation.T).magnitude()) < 0.5
