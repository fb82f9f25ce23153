"""The simulated endoscope: what its pairs show, how many there are, and what can go wrong with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import MAX_PAIRS, ConfigError, StereoImages, StereoPair
from markerseek.geometry import StereoCameras, triangulate
from markerseek.sim import EndoscopeSettings, VirtualClock, camera_above, endoscope
from markerseek.vision import LaserSpot, NoSpot, TwoSpots, find_spot
from tests.unit.sim.faulty_endoscope import FaultyEndoscope

SPOT_M = np.array([0.004, -0.003, 0.061])
CAMERA_TO_TRUS = camera_above(np.array([0.0, 0.0, 0.06]), distance_m=0.1, roll_deg=20.0, tilt_deg=8.0)
EXACT = EndoscopeSettings(calibration_sigma_px=0.0, spot_sigma_px=0.0, frames=10)


def small(cameras: StereoCameras) -> StereoCameras:
    """Images of 320 x 256 pixels, in which a spot is found sooner; the base gives disparities as in large ones."""
    lens = structs.replace(cameras.left, centre_px=(159.5, 127.5), size_px=(320, 256))
    return replace(cameras, left=lens, right=lens)


class Scene:
    """An endoscope that looks at a spot, its clock, and its laser."""

    def __init__(self, *, settings: EndoscopeSettings = EXACT, seed: int = 1, **more: Any) -> None:
        self.clock = VirtualClock()
        self.flashes = 0
        self.cameras = small(endoscope())
        self.endoscope = FaultyEndoscope(
            cameras=self.cameras,
            camera_to_trus=CAMERA_TO_TRUS,
            settings=settings,
            rng=np.random.default_rng(seed),
            clock=self.clock,
            flashes=lambda: self.flashes,
            **more,
        )
        self.endoscope.show(SPOT_M)
        self.exact = {
            side: pixels[0]
            for side, pixels in zip(
                ("left", "right"), self.cameras.project(CAMERA_TO_TRUS.inverse().apply(SPOT_M)[None]), strict=True
            )
        }

    def after(self, seconds: float, *, fire: bool = False) -> list[StereoPair]:
        self.flashes += fire
        self.clock.wait(seconds)
        return self.endoscope.newest()

    def spots(self, *, lit: list[StereoPair] | None = None) -> list[Any]:
        dark = self.after(1.0)
        lit = lit or self.after(1.0, fire=True)
        return [
            find_spot([getattr(pair, side) for pair in lit], dark=[getattr(pair, side) for pair in dark])
            for side in ("left", "right")
        ]


def test_pairs_come_at_the_rate_of_the_clock_and_are_lit_if_the_rig_has_fired() -> None:
    scene = Scene()
    x, y = np.rint(scene.exact["left"]).astype(int)

    def brightness(pairs: list[StereoPair]) -> list[bool]:
        return [bool(pair.left[y, x] > 150) for pair in pairs]

    assert isinstance(scene.endoscope, StereoImages)
    assert scene.after(0.0) == []
    assert brightness(scene.after(0.1)) == [False] * 3
    # A flash is seen in the next pair, also if no pair came at once.
    assert scene.after(0.01, fire=True) == []
    assert brightness(scene.after(0.03)) == [True]
    assert brightness(scene.after(1.0)) == [False] * 5
    lit = scene.after(30.0, fire=True)
    assert brightness(lit) == [True] * 10
    np.testing.assert_allclose(np.diff([pair.at_s for pair in lit]), 1 / 30)
    assert 0 <= scene.clock.now_s() - lit[-1].at_s < 1 / 30
    scene.endoscope.show(None)
    assert brightness(scene.after(1.0, fire=True)) == [False] * 10
    many = Scene(settings=structs.replace(EXACT, frames=1000))
    assert len(many.after(60.0, fire=True)) == MAX_PAIRS


def test_the_spot_is_where_the_cameras_project_it_and_noise_is_that_of_the_settings() -> None:
    scene = Scene(settings=structs.replace(EXACT, frames=25))
    for spot, side in zip(scene.spots(), ("left", "right"), strict=True):
        assert isinstance(spot, LaserSpot)
        np.testing.assert_allclose([spot.x_px, spot.y_px], scene.exact[side], atol=5 * spot.sigma_px)
        assert spot.sigma_px < 0.15
    dark = np.stack([pair.right for pair in scene.after(1.0)]).astype(float)
    # 3 counts, and the rounding to whole counts.
    assert dark.std(axis=0, ddof=1).mean() == pytest.approx(np.hypot(3.0, 12**-0.5) * 0.94, rel=0.02)
    between = np.corrcoef((dark - dark.mean(axis=0)).reshape(5, -1))[np.triu_indices(5, 1)]
    np.testing.assert_allclose(between, -1 / 4, atol=0.02)  # independent, once their mean is subtracted


def test_a_focal_length_that_is_stated_too_large_makes_the_depth_too_large() -> None:
    z_m = CAMERA_TO_TRUS.inverse().apply(SPOT_M)[2]
    scene = Scene(focal_error=0.05, settings=structs.replace(EXACT, noise_counts=0.0, tissue_counts=40.0))
    left, right = (np.array([[spot.x_px, spot.y_px]]) for spot in scene.spots())
    found_m = triangulate(left, right, scene.cameras, sigma_px=0.1).points_m[0]
    # Disparity = focal length x base / depth.
    assert found_m[2] / z_m == pytest.approx(1.05, abs=0.005)
    with pytest.raises(ConfigError, match="focal_error is nan"):
        Scene(focal_error=float("nan"))


def test_the_calibration_is_as_wrong_at_a_point_whenever_the_spot_is_there() -> None:
    scene = Scene(settings=structs.replace(EXACT, calibration_sigma_px=4.0))
    first = scene.spots()[0]
    scene.endoscope.show(SPOT_M + np.array([0.002, 0.0, 0.0]))
    scene.after(0.5, fire=True)
    scene.endoscope.show(SPOT_M)
    again = scene.spots()[0]
    off_px = np.array([first.x_px, first.y_px]) - scene.exact["left"]
    assert np.hypot(*off_px) > 0.5
    np.testing.assert_allclose([again.x_px, again.y_px], [first.x_px, first.y_px], atol=0.2)


@pytest.mark.parametrize(
    ("faults", "kinds"),
    [
        ({"reflection": "steady"}, (LaserSpot, LaserSpot)),  # the dark images take it away
        ({"reflection": "laser"}, (TwoSpots, TwoSpots)),
        ({"saturated": "left"}, (NoSpot, LaserSpot)),
        ({"occluded": "right"}, (LaserSpot, NoSpot)),
    ],
)
def test_faults_are_seen_in_the_images(faults: dict[str, Any], kinds: tuple[type, type]) -> None:
    scene = Scene(**faults)
    assert tuple(type(spot) for spot in scene.spots()) == kinds


def test_a_spot_moves_images_come_late_and_some_do_not_come() -> None:
    moving = Scene(settings=structs.replace(EXACT, motion_px=8.0))
    places_px = [np.array([spot.x_px, spot.y_px]) for spot in (moving.spots()[0], moving.spots()[0])]
    np.testing.assert_allclose(places_px[0], moving.exact["left"], atol=0.3)
    assert np.hypot(*(places_px[1] - places_px[0])) == pytest.approx(8.0, abs=0.3)
    late = Scene(delay_frames=6)
    x, y = np.rint(late.exact["left"]).astype(int)
    assert late.after(0.1) == []
    seen = [bool(pair.left[y, x] > 150) for pair in late.after(0.1, fire=True) + late.after(0.2) + late.after(0.2)]
    assert seen == [False] * 3 + [True] * 3 + [False] * 5
    lossy = Scene(settings=structs.replace(EXACT, frames=50, dropped_share=0.5))
    assert 12 <= len(lossy.after(50 / 30, fire=True)) <= 38
    with pytest.raises(ConfigError, match=r"dropped_share is 1\.5"):
        EndoscopeSettings(dropped_share=1.5)
