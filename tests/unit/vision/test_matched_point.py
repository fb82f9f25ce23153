"""A place of the left image is found in the right one by its texture, where the truth of the simulation has it."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from markerseek.core import ConfigError, StereoPair
from markerseek.following import FollowedRoom, TargetPath
from markerseek.registration import SimulatedRoomSettings
from markerseek.sim import STREAMING
from markerseek.vision import MatchedPoint, NotKnown, match_point


@cache
def room() -> FollowedRoom:
    return FollowedRoom(SimulatedRoomSettings(rig=STREAMING, textured=True), TargetPath(motion="still"), seed=3)


@cache
def pair() -> StereoPair:
    room().rig.scanner.clock.wait(1.0)
    return room().images.newest()[-1]


def true_right_px(left_px: tuple[float, float]) -> np.ndarray:
    """Where the right camera sees what the left one shows at a pixel, in truth."""
    cameras = room().images.cameras
    return cameras.project(room().place_at_m(left_px)[None])[1][0]


def test_places_lie_where_the_truth_has_them_and_their_errors_are_told() -> None:
    rng = np.random.default_rng(5)
    pulls = []
    refused = 0
    for _ in range(60):
        left_px = (rng.uniform(60, 1220), rng.uniform(60, 964))
        found = match_point(pair(), room().stereo.cameras, left_px)
        if isinstance(found, NotKnown):
            refused += 1
            continue
        off_px = float(np.linalg.norm(np.array(found.right_px) - true_right_px(left_px)))
        assert off_px < 1.0
        pulls.append(off_px / found.sigma_px)
    # A place on a highlight is refused; those are a fifth of this tissue.
    assert refused <= 20
    assert float(np.median(pulls)) < 1.0


def test_the_place_is_the_pixel_at_the_depth_of_the_tissue() -> None:
    left_px = (640.0, 500.0)
    found = match_point(pair(), room().stereo.cameras, left_px)
    assert isinstance(found, MatchedPoint)
    left, right = room().stereo.cameras.project(np.array(found.camera_m)[None])
    assert left[0].tolist() == pytest.approx(left_px, abs=1e-6)
    assert right[0].tolist() == pytest.approx(found.right_px, abs=1e-6)
    # The base of the calibration is off by half a per cent, its vergence by 0.3 px: 0.7 mm at 100 mm.
    true_m = room().place_at_m(left_px)
    assert math.dist(found.camera_m, true_m.tolist()) < 2e-3


@pytest.mark.parametrize(
    ("change", "cause", "said"),
    [
        (lambda image: np.full_like(image, 90), "no-texture", "there is too little texture at 640, 500"),
        (lambda image: np.full_like(image, 3), "dark", "it is dark at 640, 500 of the left image, with 3 counts"),
    ],
)
def test_a_picture_that_shows_too_little_is_refused_by_name(change, cause, said) -> None:
    changed = StereoPair(left=change(pair().left), right=pair().right, at_s=2.0)
    found = match_point(changed, room().stereo.cameras, (640.0, 500.0))
    assert isinstance(found, NotKnown)
    assert (found.cause, found.at_s) == (cause, 2.0)
    assert found.reason.startswith(said)


def test_what_the_right_camera_does_not_show_is_refused() -> None:
    other = StereoPair(left=pair().left, right=pair().right[::-1].copy(), at_s=0.0)
    found = match_point(other, room().stereo.cameras, (640.0, 500.0))
    assert isinstance(found, NotKnown)
    assert found.cause == "hidden"
    assert "is not found in the right image" in found.reason


def test_the_border_is_refused_and_a_pixel_outside_is_no_pixel() -> None:
    found = match_point(pair(), room().stereo.cameras, (20.0, 500.0))
    assert isinstance(found, NotKnown)
    assert "nearer than 49 px to its border" in found.reason
    for left_px in ((-1.0, 5.0), (1280.0, 5.0), (5.0, math.nan)):
        with pytest.raises(ConfigError, match=r"`pixel` is .*1280 x 1024"):
            match_point(pair(), room().stereo.cameras, left_px)
