"""The simulated room where the tissue breathes and somebody moves the endoscope."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
    clock, angle_deg = room.rig.scanner.clock, room.rig.facts.truth_deg
    assert angle_deg is not None
    laterals_m, ways_m = [], []
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
