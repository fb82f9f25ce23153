"""A scene that is watched while its tissue swells and falls, and while the endoscope moves."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek.vision import SceneTexture, SceneWatch, scene_texture
from tests.unit.vision.scene_world import World, cameras, moved

CAMERAS = cameras(width=480, focal_px=410.0)


@pytest.fixture(scope="module")
def world() -> World:
    return World(5, cameras=CAMERAS)


def watch_of(world: World) -> SceneWatch:
    texture = scene_texture(world.pair(), CAMERAS)
    assert isinstance(texture, SceneTexture)
    spot_m = np.array([0.0, 0.0, float(world.surface_m(np.array(0.0), np.array(0.0)))])
    return SceneWatch(texture, spot_m=spot_m, rng=np.random.default_rng(1))


def test_a_move_between_two_rests_is_told(world: World) -> None:
    watch = watch_of(world)
    truth = moved(turn_deg=(0, 0, 1), shift_mm=(1, 0, 0.5))
    before = world.pair()
    after = world.pair(truth)
    for number in range(26):
        pair = before if number < 10 else after
        # Pictures of one noise are as good here as many, and faster to render.
        watch.look(type(pair)(left=pair.left, right=pair.right, at_s=number / 2))
    told = watch.told()
    assert told.known == 1.0
    (move,) = told.endoscope
    assert move.until_s == pytest.approx(5.0, abs=0.6)
    point_m = np.array([0.01, 0.0, 0.08])
    there_m, _ = move.carried(point_m, np.zeros((3, 3)))
    np.testing.assert_allclose(there_m, truth.apply(point_m), atol=0.1e-3)
    assert told.spot == ()


def test_tissue_around_the_spot_is_seen_where_the_scene_is_not_known(world: World) -> None:
    watch = watch_of(world)
    moment = watch.look(world.pair(local_mm=lambda x, y: 1.0 * np.exp(-(x**2 + y**2) / (2 * 0.015**2))))
    assert moment.scene is None
    assert watch.not_known is not None
    assert moment.tissue is not None
    assert moment.tissue.value_m[0] == pytest.approx(0.9e-3, abs=0.2e-3)
    assert watch.told().known == 0.0


def test_a_spot_alone_is_no_pair_that_was_not_known(world: World) -> None:
    watch = watch_of(world)
    watch.look(world.pair())
    watch.place_spot(np.array([0.0, 0.0, 0.08]), 1e-9 * np.eye(3), at_s=-1.0)
    assert watch.not_known is None
    assert watch.told().known == 1.0
    assert len(watch.moments) == 2


def test_tissue_without_texture_around_the_spot_moves_with_the_scene(world: World) -> None:
    texture = scene_texture(world.pair(), CAMERAS)
    assert isinstance(texture, SceneTexture)
    # 8 mm around it no texture is seen.
    spot_m = texture.points.positions_m.max(axis=0) + np.array([12e-3, 0.0, 0.0])
    watch = SceneWatch(texture, spot_m=spot_m, rng=np.random.default_rng(1))
    truth = moved(turn_deg=(0, 0, 1), shift_mm=(1, 0, 0.5))
    moment = watch.look(world.pair(truth))
    assert moment.tissue is not None
    off_m = moment.tissue.value_m - (truth.apply(spot_m) - spot_m)
    sigma_m = np.sqrt(np.diag(moment.tissue.covariance_m2))
    assert np.linalg.norm(off_m) < 0.3e-3
    assert (np.abs(off_m) < 4 * sigma_m).all()
