"""Sessions whose endoscope is moved between two markers: carried where that is known, and refused by name elsewhere."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from benchmarks.registration.forged_markers import ForgedScene
from markerseek.core import SpotToSource
from markerseek.geometry import RigidTransform
from markerseek.registration import (
    Ended,
    EndoscopeMotion,
    EndoscopeMove,
    EndoscopeNotKnown,
    Registered,
    RegistrationSession,
    SearchScene,
    SeenEndoscope,
    SessionPlan,
    SessionView,
    SimulatedRoom,
    SimulatedRoomSettings,
    Spot,
    SpotRefused,
    SpotSeen,
    TakenMarker,
)
from markerseek.registration.choice import Choice, SeenMarker, choose
from markerseek.registration.endoscope_motion import less_breath
from markerseek.registration.marker_movement import marker_movement
from markerseek.registration.stations import carry
from markerseek.sim import STREAMING
from markerseek.vision import ClockOffset, TissueMoves
from tests.registration_sessions import begin, registered, taken

MIDDLE_M = np.array([0.0, 0.0, 0.1])
SIGMA_DEG = 0.2
SIGMA_MM = 0.25
"""Errors of the motions that are forged: as large as a motion may have that counts as known."""

SPOT = SpotToSource(depth_m=0.0, depth_sigma_m=0.0)


def forged_motion(true: RigidTransform, rng: np.random.Generator) -> EndoscopeMotion:
    """A motion as cameras see it, with errors of its covariance."""
    turned = Rotation.from_rotvec(SIGMA_DEG * rng.standard_normal(3), degrees=True).as_matrix()
    middle_m = MIDDLE_M + 1e-3 * SIGMA_MM * rng.standard_normal(3)
    before_m = true.inverse().apply(MIDDLE_M)
    rotation = turned @ true.rotation
    return EndoscopeMotion(
        since="1",
        after="3",
        displacement_mm=tuple((1e3 * (middle_m - before_m)).tolist()),
        rotation_deg=tuple(np.degrees(Rotation.from_matrix(rotation).as_rotvec()).tolist()),
        middle_mm=tuple((1e3 * middle_m).tolist()),
        covariance=tuple(map(tuple, np.diag([SIGMA_DEG**2] * 3 + [SIGMA_MM**2] * 3).tolist())),
    )


def as_taken(marker: SeenMarker, endoscope: SeenEndoscope | None) -> TakenMarker:
    return taken(
        marker.name,
        camera_m=marker.camera_m.tolist(),
        camera_covariance_m2=marker.camera_covariance_m2.tolist(),
        camera_shared_m=marker.camera_shared_m.tolist(),
        answer="found",
        candidates=list(marker.candidates),
        endoscope=endoscope,
    )


def moved_session(seed: int) -> tuple[ForgedScene, list[TakenMarker]]:
    """Four markers, before the last of which the endoscope is moved by 1 to 20 mm and 1 to 10 degrees."""
    scene = ForgedScene(seed)
    *first, last = scene.wide(4)
    before = scene.markers(first)
    way = scene.rng.standard_normal((2, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    shift_m, turn_deg = way * [[scene.rng.uniform(1e-3, 20e-3)], [scene.rng.uniform(1, 10)]]
    stood = scene.true
    scene.true = replace(
        stood,
        rotation=stood.rotation @ Rotation.from_rotvec(turn_deg, degrees=True).as_matrix(),
        translation_m=stood.apply(shift_m),
    )
    there = scene.true.inverse()
    true = RigidTransform(
        source="DaVinciBefore",
        target="DaVinci",
        rotation=there.rotation @ stood.rotation,
        translation_m=there.apply(stood.translation_m),
    )
    after = scene.seen("4", last)
    return scene, [*(as_taken(each, None) for each in before), as_taken(after, forged_motion(true, scene.rng))]


def chosen(markers: list[SeenMarker]) -> Choice:
    return choose(markers, spot=SPOT)


def test_carried_markers_register_with_the_error_that_is_said() -> None:
    errors = []
    for seed in range(40):
        scene, markers = moved_session(seed)
        choice = chosen(list(carry(markers).seen))
        assert choice.report is not None
        error_m = scene.error_m(choice.report)
        if choice.decided and error_m is not None:
            errors.append((error_m, choice.report.tre_m, choice.report.tre95_m))
    error_m, tre_m, tre95_m = np.array(errors).T
    assert len(errors) >= 36
    # Of 40 with 95 % each, fewer than 34 are covered in 3 of 1,000.
    assert np.count_nonzero(error_m <= tre95_m) >= len(errors) - 6
    assert 0.6 < np.sqrt(np.mean(error_m**2) / np.mean(tre_m**2)) < 1.2


def test_the_errors_of_the_motion_are_in_the_error_that_is_said() -> None:
    _, markers = moved_session(3)
    seen = carry(markers).seen
    with_them = chosen(list(seen)).report
    without = chosen([replace(each, camera_motion_m=None) for each in seen]).report
    assert with_them is not None
    assert without is not None
    # Three of four markers were carried: a turn of 0.2 deg about the scene moves what lies 20 mm below it by 0.07 mm.
    assert with_them.tre_m > 1.05 * without.tre_m


MOVED = forged_motion(
    RigidTransform(source="DaVinciBefore", target="DaVinci", rotation=np.eye(3), translation_m=np.full(3, 2e-3)),
    np.random.default_rng(1),
)
NOT_KNOWN = EndoscopeNotKnown(after="3", reason="the picture has too little texture")


def spot_seen(endoscope: SeenEndoscope | None) -> SpotSeen:
    spot = Spot(left_px=(1.0, 2.0), right_px=(1.0, 2.0), sigma_px=0.1)
    return SpotSeen(name="4", spot=spot, camera_m=(0.0, 0.0, 0.1), prediction=None, journal=None, endoscope=endoscope)


@pytest.mark.parametrize("endoscope", [MOVED, NOT_KNOWN])
def test_a_registration_is_withdrawn_as_soon_as_the_endoscope_may_stand_elsewhere(
    tmp_path: Path, endoscope: SeenEndoscope
) -> None:
    record = begin(tmp_path / "session")
    for name in ("1", "2", "3"):
        record.add(taken(name))
    record.add(registered(3))
    file = record.folder / "registration.json"
    assert file.exists()
    record.add(spot_seen(None))
    assert record.view.registration is not None
    record.add(spot_seen(endoscope))
    assert not file.exists()
    assert record.view.registration is None
    assert record.view.reason == endoscope.said
    assert record.view.said == f"not registered: {endoscope.said}"
    # Neither a spot that is refused brings the endoscope back, nor a session that is continued.
    record.add(SpotRefused(name="4", reason="two places are about as bright"))
    record.add(registered(3))
    assert record.view.registration is None
    record.add(taken("4", endoscope=endoscope))
    record.add(registered(4))
    assert record.view.registration is not None
    assert file.exists()
    record.close()


def test_markers_whose_place_is_lost_are_named_in_the_view() -> None:
    view = SessionView().after(taken("1")).after(taken("2", endoscope=NOT_KNOWN))
    said = registered(3, decided=False)
    view = view.after(Registered(**{name: getattr(said, name) for name in said.__struct_fields__} | {"lost": ("1",)}))
    assert view.lost == ("1",)
    assert [view.use_of(marker) for marker in view.markers] == ["lost", "not found"]


def steps_of(room: SimulatedRoom, markers: int) -> tuple[SessionView, list[Registered]]:
    """The view of a session after so many markers, and what was said after each."""
    session = RegistrationSession(room, plan=SessionPlan(sweep=True, markers=4))
    states = []
    with closing(session.steps()) as steps:
        for step in steps:
            if isinstance(step, Registered):
                states.append(step)
                if len(session.view.markers) == markers:
                    break
    return session.view, states


@pytest.mark.long
def test_a_session_goes_on_when_the_endoscope_is_moved_in_view_of_texture() -> None:
    move = EndoscopeMove(marker=4, shift_m=(6e-3, -3e-3, 5e-3), turn_deg=(2.0, -1.0, 5.0))
    settings = SimulatedRoomSettings(rig=STREAMING, textured=True, moves=(move,), endoscope_held=False)
    room = SimulatedRoom(settings, seed=5)
    view, states = steps_of(room, 4)
    seen = [marker.endoscope for marker in view.markers]
    assert [each and each.state for each in seen] == [None, "at rest", "at rest", "moved"]
    assert "the endoscope has moved after marker 3, by " in states[-1].said
    assert states[-1].lost == ()
    assert view.registration is not None
    truth = room.truth(view)
    assert truth.target_error_m is not None
    assert truth.target_error_m < view.registration.report.tre95_m < 4e-3


def test_images_without_texture_are_refused_by_name_and_end_the_session() -> None:
    room = SimulatedRoom(SimulatedRoomSettings(endoscope_held=False), seed=5)
    steps = list(RegistrationSession(room, plan=SessionPlan(sweep=True)).steps())
    (refused,) = [step for step in steps if isinstance(step, SpotRefused)]
    assert "it would not be seen if the endoscope moved: the picture has too little texture" in refused.reason
    assert "say that the endoscope is held" in refused.reason
    assert not any(isinstance(step, TakenMarker) for step in steps)
    ended = steps[-1]
    assert isinstance(ended, Ended)
    assert not ended.registered
    assert ended.said.startswith(refused.reason)


def after_four_markers(now: SeenEndoscope | None) -> tuple[ForgedScene, RegistrationSession]:
    """A session of four markers, whose cameras then see the scene as stated."""
    scene = ForgedScene(7)
    session = RegistrationSession(SimulatedRoom(SimulatedRoomSettings(endoscope_held=False), seed=5))
    for marker in scene.markers(scene.wide(4)):
        session.view = session.view.after(as_taken(marker, None))
    session.view = session.view.after(session._state())
    session._endoscope._watch = mock.Mock(look=mock.Mock(return_value=now))
    session._spots = mock.Mock(dark=mock.Mock(return_value=[mock.Mock()]))
    return scene, session


def moved_scene(scene: ForgedScene) -> EndoscopeMotion:
    """Move the endoscope of a scene by some millimetres and degrees; how its cameras see that."""
    stood = scene.true
    turn = Rotation.from_rotvec((2.0, -3.0, 1.0), degrees=True).as_matrix()
    scene.true = replace(
        stood, rotation=stood.rotation @ turn, translation_m=stood.apply(np.array([4e-3, -3e-3, 5e-3]))
    )
    there = scene.true.inverse()
    true = RigidTransform(
        source="DaVinciBefore",
        target="DaVinci",
        rotation=there.rotation @ stood.rotation,
        translation_m=there.apply(stood.translation_m),
    )
    return structs.replace(forged_motion(true, np.random.default_rng(3)), after="4")


def test_a_move_after_the_last_marker_is_noticed_and_the_registration_is_that_of_the_camera_now() -> None:
    scene, session = after_four_markers(None)
    before = session.view.registration
    assert before is not None
    motion = moved_scene(scene)
    session._endoscope._watch.look.return_value = motion
    (state,) = session._last_look()
    assert isinstance(state, Registered)
    assert state.endoscope == motion
    assert motion.said in state.said
    after = session.view.registration
    assert after is not None
    assert session.view.displaced is None
    error_m = scene.error_m(after.report)
    assert error_m is not None
    assert error_m < after.report.tre95_m
    assert scene.error_m(before.report) > 3 * before.report.tre95_m


def test_a_last_look_that_shows_nothing_withdraws_the_registration_and_one_at_rest_changes_nothing() -> None:
    _, session = after_four_markers(NOT_KNOWN)
    (state,) = session._last_look()
    assert state.lost == ("1", "2", "3", "4")
    assert session.view.registration is None
    assert session.view.displaced == NOT_KNOWN
    still = structs.replace(MOVED, displacement_mm=(0.01, 0.0, 0.0), rotation_deg=(0.01, 0.0, 0.0))
    _, session = after_four_markers(still)
    assert list(session._last_look()) == []
    assert session.view.registration is not None


def test_a_marker_that_is_measured_again_after_a_move_is_compared_with_its_carried_spot() -> None:
    scene, session = after_four_markers(None)
    first = session.view.markers[0]
    assert session.view.last is not None
    motion = moved_scene(scene)
    source_m = np.array(first.candidates[0].position.position_m)
    again = as_taken(scene.seen("1-again", scene.at(source_m[0], source_m[1])), motion)
    # The light is where it was: only the cameras moved.
    spot_m = motion.transform.apply(np.array(first.camera_m))
    again = structs.replace(again, again="1", camera_m=spot_m.tolist(), candidates=first.candidates)
    markers = carry(session.view.markers, now=motion).seen
    chosen = session.view.last.chosen
    assert not marker_movement(first, again, markers, chosen=chosen, spot=SpotToSource()).moved
    elsewhere = structs.replace(again, camera_m=np.add(spot_m, [6e-3, 0.0, 0.0]).tolist())
    assert marker_movement(first, elsewhere, markers, chosen=chosen, spot=SpotToSource()).moved


def test_a_breath_between_two_pairs_is_no_move_of_the_endoscope() -> None:
    breath = TissueMoves(
        from_s=0.0,
        until_s=9.0,
        rest_mm=(0.0, 0.0, 0.0),
        swing_mm=(0.0, 2.0, 1.0),
        covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
        period_s=4.0,
        period_sigma_s=0.1,
        pause_at_s=0.0,
        pause_s=1.5,
    )
    in_breath = structs.replace(MOVED, displacement_mm=(0.05, 1.4, 0.7), rotation_deg=(0.0, 0.02, 0.0))
    assert in_breath.state == "moved"
    assert less_breath(in_breath, breath).state == "at rest"
    # What is not along the breath, or beyond it, stays.
    beside = structs.replace(MOVED, displacement_mm=(1.0, 1.4, 0.7), rotation_deg=(0.0, 0.02, 0.0))
    assert less_breath(beside, breath).displacement_mm == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    beyond = structs.replace(MOVED, displacement_mm=(0.0, 4.0, 2.0))
    assert less_breath(beyond, breath).displacement_mm == pytest.approx((0.0, 2.0, 1.0), abs=1e-9)


def after_a_breath() -> RegistrationSession:
    """A session during whose last search the tissue was seen to breathe."""
    _, session = after_four_markers(None)
    breath = TissueMoves(
        from_s=-9.0,
        until_s=0.0,
        rest_mm=(0.0, 0.0, 0.0),
        swing_mm=(0.0, 2.0, 0.0),
        covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
        period_s=4.0,
        period_sigma_s=0.1,
        pause_at_s=-1.0,
        pause_s=1.5,
    )
    scene = SearchScene(pairs=60, known=1.0, tissue=breath, clock=ClockOffset(offset_s=0.1, sigma_s=0.01))
    session.view = replace(
        session.view, markers=(*session.view.markers[:-1], structs.replace(session.view.markers[-1], scene=scene))
    )
    session._breath.moves = breath
    return session


def test_a_spot_on_tissue_that_breathes_is_not_compared_in_pixels_where_only_pauses_were_seen() -> None:
    seen = SearchScene(pairs=60, known=1.0)
    session = after_a_breath()
    session._spots.require_still = mock.Mock()
    session._require_still(mock.Mock(), mock.Mock(), seen)
    session._spots.require_still.assert_not_called()
    # Where too little was seen of this search, the pixels are all there is.
    session._require_still(mock.Mock(), mock.Mock(), structs.replace(seen, known=0.2))
    session._spots.require_still.assert_called_once()
    _, still = after_four_markers(None)
    still._spots.require_still = mock.Mock()
    still._require_still(mock.Mock(), mock.Mock(), seen)
    still._spots.require_still.assert_called_once()


@pytest.mark.long
def test_a_session_goes_on_where_the_endoscope_moves_during_a_search() -> None:
    move = EndoscopeMove(marker=2, after_s=5.0, shift_m=(3e-3, -2e-3, 4e-3), turn_deg=(2.0, -3.0, 4.0), lasts_s=0.5)
    settings = SimulatedRoomSettings(rig=STREAMING, textured=True, moves=(move,), endoscope_held=False)
    room = SimulatedRoom(settings, seed=5)
    view, _ = steps_of(room, 4)
    moved = view.markers[1]
    assert moved.scene is not None
    assert len(moved.scene.endoscope) == 1
    assert moved.endoscope is not None
    assert moved.endoscope.state == "moved"
    truth = room.truth(view)
    assert truth.target_error_m is not None
    assert view.registration is not None
    assert truth.target_error_m < view.registration.report.tre95_m
