"""A rendered scene that moves: its motion is found with its errors, or said not to be known, by name."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, StereoPair
from markerseek.geometry import CalibrationErrors, RigidTransform, StereoMotion
from markerseek.vision import NotKnown, SceneFollower, SceneSeen, SceneTexture, scene_texture
from tests.unit.vision.scene_world import World, cameras, moved

CAMERAS = cameras()


@pytest.fixture(scope="module")
def world() -> World:
    return World(3, cameras=CAMERAS)


@pytest.fixture(scope="module")
def texture(world: World) -> SceneTexture:
    exact = CalibrationErrors(focal_share=0.0, base_share=0.0, vergence_px=0.0)
    found = scene_texture(world.pair(), CAMERAS, calibration=exact)
    assert isinstance(found, SceneTexture)
    return found


def follow(texture: SceneTexture, *pairs: StereoPair) -> SceneSeen | NotKnown:
    """What a follower says of the last of some pairs."""
    follower = SceneFollower(texture, rng=np.random.default_rng(1))
    return [follower.follow(pair) for pair in pairs][-1]


def known(seen: SceneSeen | NotKnown) -> StereoMotion:
    assert isinstance(seen, SceneSeen), seen
    assert isinstance(seen.motion, StereoMotion), seen.motion
    return seen.motion


def square(motion: StereoMotion, truth: RigidTransform) -> float:
    """Squared error of a motion over its covariance."""
    turn = Rotation.from_matrix(truth.rotation @ motion.transform.rotation.T).as_rotvec()
    middle_m = motion.middle_m
    shift = truth.apply(motion.transform.inverse().apply(middle_m)) - middle_m
    miss = np.concatenate([turn, shift])
    return float(miss @ np.linalg.solve(motion.covariance, miss))


def test_depths_are_those_of_the_surface(world: World, texture: SceneTexture) -> None:
    points_m = texture.points.positions_m
    apart = points_m[:, 2] - world.surface_m(points_m[:, 0], points_m[:, 1])
    assert len(points_m) > 100
    assert np.median(np.abs(apart)) < 0.5e-3
    expected_m = texture.points.sigma_per_m * points_m[:, 2] ** 2
    assert 0.2 < np.median(np.abs(apart)) / np.median(expected_m) < 3


@pytest.mark.parametrize(
    "truth",
    [
        pytest.param(moved(), id="still"),
        pytest.param(moved(shift_mm=(0.5, 0, 0)), id="half a millimetre across"),
        pytest.param(moved(shift_mm=(0, 0, 0.5)), id="half a millimetre along the view"),
        pytest.param(moved(turn_deg=(0.3, 0, 0)), id="0.3 deg"),
        pytest.param(moved(turn_deg=(2, -1, 4), shift_mm=(3, 2, -4)), id="some"),
        pytest.param(moved(turn_deg=(5, -4, 8), shift_mm=(10, -6, 12)), id="much, at once"),
    ],
)
def test_the_motion_is_as_near_as_its_covariance_says(
    world: World, texture: SceneTexture, truth: RigidTransform
) -> None:
    motion = known(follow(texture, world.pair(truth)))
    # The 99.99 % quantile of chi squared with six degrees of freedom.
    assert square(motion, truth) < 27.9
    assert np.linalg.eigvalsh(motion.covariance[3:, 3:])[-1] < (0.1e-3) ** 2
    assert np.degrees(np.linalg.eigvalsh(motion.covariance[:3, :3])[-1] ** 0.5) < 0.1


def test_the_same_picture_twice_is_at_rest(world: World) -> None:
    pair = world.pair()
    texture = scene_texture(pair, CAMERAS)
    assert isinstance(texture, SceneTexture)
    motion = known(follow(texture, pair))
    np.testing.assert_allclose(motion.transform.matrix, np.eye(4), atol=1e-9)


def test_exposure_and_focus_change_nothing(world: World, texture: SceneTexture) -> None:
    truth = moved(shift_mm=(1, 0.5, 1))
    motion = known(follow(texture, world.pair(truth, exposure=0.55, blur_px=1.0)))
    assert square(motion, truth) < 27.9


def test_an_instrument_that_moves_through_the_picture_is_not_the_scene(world: World) -> None:
    def with_rod(pair: StereoPair, x: int, y: int) -> StereoPair:
        images = []
        for image, nearer_px in ((pair.left, 0), (pair.right, 60)):
            drawn = image.copy()
            cv2.line(drawn, (x - nearer_px, y), (x + 300 - nearer_px, y - 160), 150, 60)
            for step in range(0, 300, 25):
                cv2.circle(drawn, (x + step - nearer_px, y - step * 160 // 300), 9, 40 + 7 * (step // 25), -1)
            images.append(drawn)
        return StereoPair(left=images[0], right=images[1], at_s=pair.at_s)

    texture = scene_texture(with_rod(world.pair(), 300, 300), CAMERAS)
    assert isinstance(texture, SceneTexture)
    truth = moved(shift_mm=(0.4, 0, 0))
    motion = known(follow(texture, with_rod(world.pair(truth), 330, 320)))
    assert square(motion, truth) < 27.9


def test_highlights_that_stay_at_the_camera_are_not_the_scene(world: World) -> None:
    def with_highlights(pair: StereoPair) -> StereoPair:
        images = []
        for image in (pair.left, pair.right):
            drawn = image.copy()
            for x, y in np.random.default_rng(1).integers(60, 420, (30, 2)):
                cv2.circle(drawn, (int(x) + 80, int(y)), 7, 255, -1)
            images.append(cv2.GaussianBlur(drawn, (0, 0), 1.0))
        return StereoPair(left=images[0], right=images[1], at_s=pair.at_s)

    texture = scene_texture(with_highlights(world.pair()), CAMERAS)
    assert isinstance(texture, SceneTexture)
    truth = moved(shift_mm=(0.5, -0.5, 0.3))
    motion = known(follow(texture, with_highlights(world.pair(truth))))
    assert square(motion, truth) < 27.9


def test_tissue_that_swells_while_the_camera_stands_is_no_motion_of_the_scene(
    world: World, texture: SceneTexture
) -> None:
    def swell_mm(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1.5 * np.exp(-((x - 0.005) ** 2 + y**2) / (2 * 0.013**2))

    seen = follow(texture, world.pair(local_mm=swell_mm))
    assert isinstance(seen, SceneSeen)
    assert isinstance(seen.motion, NotKnown)
    assert seen.motion.cause in ("deforms", "several-motions")
    there_m = np.array([0.005, 0.0, float(world.surface_m(np.array(0.005), np.array(0.0)))])
    displacement = seen.displacement_near(there_m)
    assert displacement is not None
    # The mean of a Gaussian of 13 mm over a disc of 8 mm is 0.91 of its height.
    moved_m, covariance_m2 = displacement
    assert moved_m[0] == pytest.approx(1.37e-3, abs=0.2e-3)
    assert np.linalg.eigvalsh(covariance_m2)[-1] < (0.5e-3) ** 2
    far = seen.displacement_near(np.array([0.5, 0.0, 0.08]))
    assert far is None


@pytest.mark.parametrize(
    ("cause", "changed"),
    [
        ("dark", {"exposure": 0.01}),
        ("blurred", {"blur_px": 12.0}),
    ],
)
def test_what_the_picture_does_not_suffice_for_is_said(
    world: World, texture: SceneTexture, cause: str, changed: dict[str, float]
) -> None:
    seen = follow(texture, world.pair(moved(shift_mm=(1, 0, 0)), **changed))
    assert isinstance(seen, NotKnown)
    assert seen.cause == cause
    assert seen.reason


def test_another_scene_is_not_known(texture: SceneTexture) -> None:
    seen = follow(texture, World(4, cameras=CAMERAS).pair())
    assert isinstance(seen, NotKnown)
    assert seen.cause in ("hidden", "several-motions")


def test_after_a_dark_picture_the_scene_is_found_again(world: World, texture: SceneTexture) -> None:
    truth = moved(turn_deg=(0, 0, 3), shift_mm=(4, 0, 0))
    motion = known(follow(texture, world.pair(exposure=0.02), world.pair(truth)))
    assert square(motion, truth) < 27.9


@pytest.mark.parametrize(("cause", "brightness"), [("dark", 4), ("no-texture", 120)])
def test_a_picture_without_texture_is_no_reference(cause: str, brightness: int) -> None:
    rng = np.random.default_rng(1)
    images = [
        np.clip(brightness + 2 * rng.standard_normal((512, 640)), 0, 255).astype(np.uint8) for _ in ("left", "right")
    ]
    found = scene_texture(StereoPair(left=images[0], right=images[1], at_s=3.0), CAMERAS)
    assert isinstance(found, NotKnown)
    assert found.cause == cause
    assert found.at_s == 3.0


def test_images_of_another_size_are_refused(world: World, texture: SceneTexture) -> None:
    pair = world.pair()
    small = StereoPair(left=pair.left[:-2], right=pair.right[:-2], at_s=0.0)
    with pytest.raises(ConfigError, match="left image: images of 640 x 510 pixels"):
        follow(texture, small)
    with pytest.raises(ConfigError, match="left image"):
        scene_texture(small, CAMERAS)
