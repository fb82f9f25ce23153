"""Textured tissue before a simulated endoscope: against the geometry of cameras and against OpenCV's tracking."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import ConfigError, Float64, StereoPair
from markerseek.geometry import RigidTransform, StereoCameras, triangulate
from markerseek.sim import (
    EndoscopeSettings,
    SimulatedEndoscope,
    TexturedTissue,
    VirtualClock,
    camera_above,
    endoscope,
)

LEVEL_M = 0.06
TISSUE = TexturedTissue.drawn(seed=5, level_m=LEVEL_M, relief_m=5e-3, contrast=0.25)
CAMERA = camera_above(np.array([0.0, 0.0, LEVEL_M]), distance_m=0.1, roll_deg=20.0, tilt_deg=30.0)
QUIET = EndoscopeSettings(noise_counts=0.0, highlight_counts=0.0, spot_sigma_px=0.0, calibration_sigma_px=0.0)
SMALL_PX = (640, 512)


def small() -> StereoCameras:
    cameras = endoscope(focal_px=550.0)
    lens = structs.replace(cameras.left, centre_px=(319.5, 255.5), size_px=SMALL_PX)
    return replace(cameras, left=lens, right=lens)


class View:
    """An endoscope before textured tissue, its clock and its laser."""

    def __init__(self, settings: EndoscopeSettings = QUIET, **more: Any) -> None:
        self.clock = VirtualClock()
        self.flashes = 0
        self.cameras = small()
        self.endoscope = SimulatedEndoscope(
            cameras=self.cameras,
            camera_to_trus=CAMERA,
            settings=settings,
            rng=np.random.default_rng(1),
            clock=self.clock,
            flashes=lambda: self.flashes,
            tissue=TISSUE,
            **more,
        )

    def pair(self, after_s: float = 1.0, *, fire: bool = False) -> StereoPair:
        self.flashes += fire
        self.clock.wait(after_s)
        return self.endoscope.newest()[-1]


def tracked(before: np.ndarray, after: np.ndarray) -> tuple[Float64[np.ndarray, "points 2"], np.ndarray]:
    """Corners of one image, and where OpenCV's pyramidal Lucas and Kanade finds them in another."""
    cv2 = pytest.importorskip("cv2")
    corners = cv2.goodFeaturesToTrack(before, maxCorners=150, qualityLevel=0.02, minDistance=12)
    found, known, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(25, 25), maxLevel=4)
    back, _, _ = cv2.calcOpticalFlowPyrLK(after, before, found, None, winSize=(25, 25), maxLevel=4)
    good = (known[:, 0] == 1) & (np.linalg.norm(back - corners, axis=-1)[:, 0] < 0.2)
    return corners[good, 0].astype(float), found[good, 0].astype(float)


def on_surface(pixels: Float64[np.ndarray, "points 2"], camera_to_trus: RigidTransform) -> np.ndarray:
    """Where lines of sight meet the tissue, in the TRUS frame."""
    rays = np.column_stack([small().left.undistort(pixels), np.ones(len(pixels))]) @ camera_to_trus.rotation.T
    places_m = TISSUE.met_by(camera_to_trus.translation_m, rays)
    return np.column_stack([places_m, TISSUE.height_m(places_m)])


def test_lines_of_sight_meet_the_surface() -> None:
    pixels = np.random.default_rng(2).uniform([20, 20], [620, 490], size=(200, 2))
    points_m = on_surface(pixels, CAMERA)
    np.testing.assert_allclose(small().left.project(CAMERA.inverse().apply(points_m)), pixels, atol=0.1)
    assert 3e-3 < np.ptp(points_m[:, 2]) < 5e-3


def test_both_cameras_see_the_same_surface() -> None:
    view = View()
    pair = view.pair()
    left, right = tracked(pair.left, pair.right)
    assert len(left) > 60
    seen_m = CAMERA.apply(triangulate(left, right, view.cameras, sigma_px=0.2).points_m)
    away_m = np.linalg.norm(seen_m - on_surface(left, CAMERA), axis=1)
    # 0.1 px of 28 px are 0.4 mm along the view.
    assert np.median(away_m) < 0.5e-3


@pytest.mark.parametrize("what", ["tissue", "endoscope"])
def test_what_moves_moves_the_picture_as_geometry_says(what: str) -> None:
    shift_m = np.array([1.5e-3, -1.0e-3, 2.0e-3])
    view = View(displacement_m=lambda at_s: shift_m if at_s > 1.5 and what == "tissue" else np.zeros(3))
    before = view.pair()
    later = CAMERA
    if what == "endoscope":
        turn = camera_above(np.zeros(3), distance_m=0.1, roll_deg=24.0, tilt_deg=28.0)
        later = replace(CAMERA, rotation=turn.rotation, translation_m=CAMERA.translation_m + shift_m)
        view.endoscope.move(later)
    after = view.pair(5.0)
    here, there = tracked(before.left, after.left)
    assert len(here) > 60
    moved_m = on_surface(here, CAMERA) + (shift_m if what == "tissue" else 0)
    expected = view.cameras.left.project(later.inverse().apply(moved_m))
    away_px = np.linalg.norm(there - expected, axis=1)
    assert np.median(np.linalg.norm(expected - here, axis=1)) > 5
    assert np.median(away_px) < 0.15


def test_a_move_lasts_its_time_and_the_pose_is_known_at_any_time() -> None:
    view = View()
    view.clock.wait(10.0)
    to = replace(CAMERA, translation_m=CAMERA.translation_m + np.array([4e-3, 0.0, 0.0]))
    view.endoscope.move(to, after_s=2.0, lasts_s=8.0)
    shifts_mm = [
        1e3 * float(view.endoscope.pose(at_s).translation_m[0] - CAMERA.translation_m[0])
        for at_s in (0.0, 12.0, 16.0, 20.0, 99.0)
    ]
    assert shifts_mm == pytest.approx([0.0, 0.0, 2.0, 4.0, 4.0])
    with pytest.raises(ConfigError, match=r"endoscope: lasts_s is -1\.0 s"):
        view.endoscope.move(to, lasts_s=-1.0)


def test_the_spot_moves_with_the_tissue_and_stays_on_it() -> None:
    spot_m = np.array([0.004, -0.003, float(TISSUE.height_m(np.array([[0.004, -0.003]]))[0])])
    view = View(displacement_m=lambda at_s: np.array([0.0, 3e-3, 0.0]) * (at_s > 1.5))
    view.endoscope.show(spot_m)
    first = view.pair(fire=True)
    second = view.pair(fire=True)
    for pair, at_m in ((first, spot_m), (second, spot_m + np.array([0.0, 3e-3, 0.0]))):
        x, y = view.cameras.left.project(CAMERA.inverse().apply(at_m)[None])[0]
        rows, columns = np.indices(pair.left.shape)
        near = np.hypot(columns - x, rows - y) < 25
        bright = np.clip(pair.left.astype(float) - 120, 0, None) * near
        centre = [(bright * axis).sum() / bright.sum() for axis in (columns, rows)]
        assert centre == pytest.approx([x, y], abs=0.7)


def test_highlights_are_elsewhere_on_the_tissue_for_each_camera() -> None:
    shining = View(structs.replace(QUIET, highlight_counts=250.0)).pair()
    matt = View().pair()
    light = [np.argwhere(a.astype(int) - b > 100) for a, b in ((shining.left, matt.left), (shining.right, matt.right))]
    assert min(map(len, light)) > 100
    near_m = TISSUE.highlights_m(CAMERA.translation_m)
    far_m = TISSUE.highlights_m(CAMERA.translation_m + np.array([10e-3, 0.0, 0.0]))
    # Of a sphere of radius r at the distance d, right below: r·10 mm/d.
    below = np.linalg.norm(TISSUE.bumps_m - CAMERA.translation_m[:2], axis=1) < 20e-3
    distance_m = float(CAMERA.translation_m[2]) - LEVEL_M
    share = np.linalg.norm(far_m - near_m, axis=1)[below] / TISSUE.bump_radius_m[below]
    np.testing.assert_allclose(share, 10e-3 / distance_m, rtol=0.15)


def test_exposure_and_an_instrument_change_over_time() -> None:
    view = View(structs.replace(QUIET, exposure_swing=0.3))
    means = [float(view.pair(after_s).left.mean()) for after_s in (11 / 4, 11 / 2)]
    assert means[0] / means[1] == pytest.approx(1.3 / 0.7, rel=0.03)
    view = View(structs.replace(QUIET, instrument=True))
    one = view.pair(5 / 4).left.astype(int)
    other = view.pair(5 / 2).left.astype(int)
    covered = np.abs(one - View().pair().left) > 15
    assert 0.02 < covered.mean() < 0.4
    assert (np.abs(one - other) > 15).mean() > 0.01


def test_tissue_without_texture_looks_as_before() -> None:
    def pairs(**more: Any) -> StereoPair:
        clock = VirtualClock()
        made = SimulatedEndoscope(
            cameras=small(),
            camera_to_trus=CAMERA,
            settings=EndoscopeSettings(),
            rng=np.random.default_rng(1),
            clock=clock,
            flashes=lambda: 0,
            **more,
        )
        clock.wait(1.0)
        return made.newest()[-1]

    plain = pairs()
    moved = pairs(displacement_m=lambda _: np.full(3, 1e-3))
    np.testing.assert_array_equal(plain.left, moved.left)
    assert not np.array_equal(plain.left, pairs(tissue=TISSUE).left)
