"""The simulated room where the tissue breathes and somebody moves the endoscope."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import SpotToSource
from markerseek.registration import EndoscopeMove, SimulatedRoom, SimulatedRoomSettings, Waiting
from markerseek.sim import SimulatedSettings, TissueMotion

PLACES_M = ((0.0, 0.0), (10e-3, 5e-3), (-10e-3, 5e-3))
BREATHING = TissueMotion(breathing_mm=2.0, phase=0.3, direction=(0.0, 1.0, 0.0))


def waiting(name: str) -> Waiting:
    return Waiting(name=name, place=None, said="")


def test_the_endoscope_is_moved_between_markers_and_within_one() -> None:
    moves = (
        EndoscopeMove(marker=2, shift_m=(3e-3, 0.0, 0.0)),
        EndoscopeMove(marker=3, after_s=5.0, turn_deg=(0.0, 0.0, 6.0), lasts_s=10.0),
    )
    room = SimulatedRoom(SimulatedRoomSettings(places_m=PLACES_M, moves=moves), seed=4)
    first = room.true
    assert room.ask(waiting("A"))
    assert room.true is first
    assert room.ask(waiting("B"))
    assert room.ask(waiting("B"))
    second = room.true
    np.testing.assert_allclose(first.inverse().apply(second.translation_m), [3e-3, 0, 0], atol=1e-12)
    assert room.ask(waiting("C"))
    clock = room.rig.scanner.clock
    turned = []
    for _ in range(4):
        turned.append(np.degrees(Rotation.from_matrix(first.rotation.T @ room.true.rotation).magnitude()))
        clock.wait(5.0)
    assert turned == pytest.approx([0.0, 0.0, 3.0, 6.0], abs=1e-5)
    np.testing.assert_allclose(room.true.translation_m, second.translation_m)


def test_cameras_and_probe_see_the_same_motion_of_the_tissue() -> None:
    settings = SimulatedRoomSettings(rig=SimulatedSettings(motion=BREATHING), places_m=PLACES_M, textured=True)
    room = SimulatedRoom(settings, seed=4)
    assert room.ask(waiting("A"))
    clock = room.rig.scanner.clock
    angle_deg = room.rig.facts.truth_deg
    assert angle_deg is not None
    laterals_m = []
    ways_m = []
    for _ in range(3):
        clock.wait(0.8)
        laterals_m.append(room.rig.scanner.measure(angle_deg).reading.lateral_m)
        # In the middle of its 16 pulses.
        ways_m.append(room.images._scene(room._movable.world.flashes[-1].at_s + 7.5 / 100).displaced_m[1])
    np.testing.assert_allclose(np.diff(np.array(laterals_m, dtype=float)), np.diff(ways_m), atol=0.15e-3)
    assert np.ptp(ways_m) > 1e-3


def test_what_is_drawn_for_a_session_does_not_depend_on_the_look_of_the_tissue() -> None:
    plain, textured = (SimulatedRoom(SimulatedRoomSettings(textured=textured), seed=4) for textured in (False, True))
    assert plain.ask(waiting("A"))
    assert textured.ask(waiting("A"))
    np.testing.assert_array_equal(plain.true.matrix, textured.true.matrix)
    one_m, other_m = (room._spots_m["A"] for room in (plain, textured))
    np.testing.assert_array_equal(one_m[:2], other_m[:2])
    assert abs(one_m[2] - other_m[2]) < 5e-3


def test_the_source_of_a_spot_lies_below_and_beside_it_and_stays_there() -> None:
    below_m = []
    beside_m = []
    for seed in range(20):
        settings = SimulatedSettings()
        marker = structs.replace(settings.marker, beside_spot_m=0.3e-3)
        spot = SpotToSource(depth_m=1e-3, depth_sigma_m=0.0)
        room = SimulatedRoom(
            SimulatedRoomSettings(rig=structs.replace(settings, marker=marker, spot=spot), places_m=PLACES_M), seed=seed
        )
        assert room.rig.spot == spot
        for name in "ABC":
            assert room.ask(waiting(name))
            spot_m = room._spots_m[name]
            way_m = room._source_m(spot_m) - spot_m
            assert room.ask(waiting(name))
            np.testing.assert_array_equal(room._source_m(spot_m) - spot_m, way_m)
            sight = spot_m - room.true.translation_m
            sight /= np.linalg.norm(sight)
            below_m.append(way_m @ sight)
            beside_m += [(way_m - (way_m @ sight) * sight) @ each for each in np.eye(3)]
    assert np.mean(below_m) == pytest.approx(1e-3, abs=0.15e-3)
    # Two of three directions are across the line of sight.
    assert np.std(beside_m) == pytest.approx(0.3e-3 * np.sqrt(2 / 3), rel=0.2)
