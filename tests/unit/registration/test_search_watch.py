"""What the cameras tell of a search: pictures of a scene of its own, with a spot that is drawn into them."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import FrameHeader, StereoPair
from markerseek.geometry import RigidTransform
from markerseek.registration import SearchScene, Spot, StereoSettings
from markerseek.registration.choice import SeenMarker
from markerseek.registration.search_watch import SearchWatch
from markerseek.registration.spots import Looked
from markerseek.vision import NotKnown, SceneTexture, scene_texture
from tests.unit.vision.scene_world import World, cameras, moved

CAMERAS = cameras(width=480, focal_px=410.0)
LATE_S = 0.2
"""How much later than the rig's clock that of the cameras is."""


@pytest.fixture(scope="module")
def world() -> World:
    return World(5, cameras=CAMERAS)


SPOT_M = np.array([0.004, -0.003, 0.0])


def spot_m(world: World) -> np.ndarray:
    x, y, _ = SPOT_M
    return np.array([x, y, float(world.surface_m(np.array(x), np.array(y)))])


def places_px(point_m: np.ndarray) -> dict[str, np.ndarray]:
    """Where both cameras see a point."""
    return {
        "left": CAMERAS.left.project(point_m[None])[0],
        "right": CAMERAS.right.project(CAMERAS.left_to_right.apply(point_m)[None])[0],
    }


def lit(pair: StereoPair, point_m: np.ndarray) -> StereoPair:
    """A pair with the laser's spot at a point."""
    images = {}
    for side, (x, y) in places_px(point_m).items():
        image = getattr(pair, side).astype(float)
        rows, columns = np.indices(image.shape)
        light = 120 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 3.0**2))
        images[side] = np.clip(np.rint(image + light), 0, 255).astype(np.uint8)
    return replace(pair, **images)


def watch_of(world: World) -> SearchWatch:
    dark = world.pair(at_s=-0.5)
    at_m = spot_m(world)
    px = {f"{side}_px": tuple(place.tolist()) for side, place in places_px(at_m).items()}
    looked = Looked(spot=Spot(**px, sigma_px=0.05), dark=(dark,), lit=(lit(world.pair(at_s=-0.3), at_m),))
    texture = scene_texture(dark, CAMERAS)
    assert isinstance(texture, SceneTexture)
    return SearchWatch(texture, looked=looked, spot_m=at_m, stereo=StereoSettings.of(CAMERAS, calibration_sigma_px=0.1))


def followed(
    world: World, truth: list[RigidTransform], *, every_s: float = 0.5, slid_mm: tuple[float, ...] = ()
) -> SearchWatch:
    """Follow a scene; every third pair is lit. ``slid_mm``: how far the spot has slid to the right, pair by pair."""
    watch = watch_of(world)
    pictures: dict[int, StereoPair] = {}
    for number, motion in enumerate(truth):
        if id(motion) not in pictures:
            pictures[id(motion)] = world.pair(motion)
        pair = pictures[id(motion)]
        slid_m = np.array([1e-3 * slid_mm[number], 0.0, 0.0]) if slid_mm else np.zeros(3)
        shown = lit(pair, motion.apply(spot_m(world) + slid_m)) if number % 3 == 0 else pair
        watch.look(replace(shown, at_s=number * every_s + LATE_S))
        if number % 3 == 0:
            at_s = number * every_s - 0.01
            watch.fire(
                FrameHeader(sequence=number, token="", pulses=1, commanded_deg=0.0, started_s=at_s, ended_s=at_s)
            )
    return watch


def test_nothing_moves_in_a_still_scene_and_the_spot_is_seen_in_its_lit_pairs(world: World) -> None:
    watch = followed(world, [moved()] * 20)
    told = watch.scene()
    assert not told.moved
    assert told.end is None
    assert told.known == 1.0
    assert told.pairs == 20
    assert len(watch.later) == 7
    assert watch.is_settled
    assert told.said == "nothing moved during the search, as 100% of 20 image pairs show"


def test_the_blinking_shows_the_offset_of_the_cameras_clock(world: World) -> None:
    clock = followed(world, [moved()] * 12).clock()
    assert clock is not None
    assert clock.offset_s == pytest.approx(LATE_S - 0.01, abs=0.03)


def test_what_looks_like_a_spot_while_the_laser_is_dark_is_not_drawn_as_one(world: World) -> None:
    watch = followed(world, [moved()] * 36)
    shown_s = watch.motion("1", breath=None).spot_s
    assert len(shown_s) == 12
    dark_s = 7 * 0.5 + LATE_S + 0.25
    watch.look(replace(lit(world.pair(), spot_m(world)), at_s=dark_s))
    assert watch.moments[-1].spot is not None
    assert watch.motion("1", breath=None).spot_s == shown_s


def test_a_spot_that_slides_is_told_and_one_that_stays_on_moving_tissue_is_not(world: World) -> None:
    still = moved()
    slid = followed(world, [still] * 24, slid_mm=(0.0,) * 12 + (1.5,) * 12).scene()
    assert slid.spot is not None
    assert slid.spot.displacement_mm[0] == pytest.approx(1.5, abs=0.3)
    assert "the spot slid on the tissue by 1." in slid.said
    there = moved(shift_mm=(1.5, 0, 0))
    carried = followed(world, [still] * 12 + [there] * 18).scene()
    assert carried.spot is None
    assert len(carried.endoscope) == 1


def test_a_spot_is_carried_to_the_end_of_a_search_in_which_the_endoscope_moved(world: World) -> None:
    truth = moved(turn_deg=(1, -2, 3), shift_mm=(2, -1, 3))
    watch = followed(world, [moved()] * 10 + [truth] * 18)
    told = watch.scene()
    assert told.end is not None
    assert np.linalg.norm(
        Rotation.from_rotvec(told.end.rotation_deg, degrees=True).as_matrix() - truth.rotation
    ) == pytest.approx(0.0, abs=2e-3)
    seen = SeenMarker(
        name="1",
        candidates=(),
        camera_m=spot_m(world),
        camera_covariance_m2=1e-10 * np.eye(3),
        camera_shared_m=np.zeros((3, 5)),
    )
    there = watch.at_end(seen, told.end)
    np.testing.assert_allclose(there.camera_m, truth.apply(spot_m(world)), atol=0.3e-3)
    sigma_m = np.sqrt(np.diag(there.camera_covariance_m2))
    assert (np.abs(there.camera_m - truth.apply(spot_m(world))) < 4 * sigma_m + 0.1e-3).all()
    # As it was stored.
    assert msgspec.json.decode(msgspec.json.encode(told), type=SearchScene) == told


def test_a_move_that_has_just_begun_is_not_settled(world: World) -> None:
    assert not followed(world, [moved()] * 10 + [moved(shift_mm=(2, 0, 0))] * 4).is_settled
    # One step, of which a cosine makes a breath: nothing has come back.
    stays = [moved(shift_mm=(1.5, 3.5, -5.0))] * 26
    assert not followed(world, [moved()] * 14 + stays, every_s=0.15).is_settled


def test_tissue_that_breathes_is_told_with_its_period_and_its_rest(world: World) -> None:
    # A saw with a pause, which is none of the shapes that are fitted; pictures at five depths of breath.
    depths = [moved(shift_mm=(0, depth, 0)) for depth in (0.0, 0.5, 1.0, 1.5, 2.0)]
    cycle = [0, 0, 0, 0, 1, 2, 3, 4, 3, 2, 1, 0]
    watch = followed(world, [depths[cycle[number % 12]] for number in range(40)], every_s=0.3)
    told = watch.scene()
    assert told.endoscope == ()
    assert told.tissue is not None
    assert told.tissue.period_s == pytest.approx(3.6, abs=0.1)
    assert told.tissue.amplitude_mm == pytest.approx(1.0, abs=0.15)
    assert told.end is not None
    np.testing.assert_allclose(told.end.displacement_mm, [0, 0, 0], atol=0.25)
    assert watch.is_settled


def test_a_scene_without_texture_is_not_followed_and_says_why() -> None:
    looked = Looked(spot=Spot(left_px=(1.0, 1.0), right_px=(1.0, 1.0), sigma_px=0.1))
    watch = SearchWatch(
        NotKnown(at_s=0.0, cause="no-texture", reason="the picture has too little texture"),
        looked=looked,
        spot_m=np.array([0.0, 0.0, 0.1]),
        stereo=StereoSettings.of(CAMERAS, calibration_sigma_px=0.1),
    )
    assert not watch.follows
    told = watch.scene()
    assert not told.is_known
    assert told.said == "motion during the search is not known: the picture has too little texture"
