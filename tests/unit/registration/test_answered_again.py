"""A search in breathing tissue that is answered again with what cameras saw: its marker is where it rests."""

from __future__ import annotations

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import Found, MarkerCandidate, MarkerPosition, Measured, RecordError, SearchPlan
from markerseek.records.journal import JournalEvent
from markerseek.registration import CorrectedMarker, SessionView
from markerseek.registration.answered_again import KeptSearch, KeptSearches, with_header
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue, SeenScene
from markerseek.rigs import simulated
from markerseek.runs import new_run, plan_on
from markerseek.sim import STREAMING, TissueMotion
from markerseek.vision import ClockOffset, Moment, Sighting, TissueMoves
from tests.registration_sessions import taken

MOTION = TissueMotion(breathing_mm=1.0, phase=0.2, direction=(0.8, 0.5, 0.3))
LATERAL_M = 4e-3

TURN = Rotation.from_euler("xyz", (170.0, 20.0, 40.0), degrees=True).as_matrix()
"""From the cameras to the probe."""


@pytest.fixture(scope="module")
def kept() -> tuple[KeptSearch, float]:
    """A search by sweeps that knew of no motion, what exact cameras saw meanwhile, and the marker's angle at rest."""
    marker = structs.replace(STREAMING.marker, lateral_m=LATERAL_M)
    rig = simulated(seed=5, settings=structs.replace(STREAMING, marker=marker, motion=MOTION))
    run = new_run(rig, plan_on(rig, SearchPlan(sweep=True)))
    events: list[JournalEvent] = [with_header(event) for event in run.events()]
    clock = rig.scanner.clock
    at_s = np.arange(0.0, clock.now_s() + 8.0, 0.1)
    seen_m = MOTION.displacement_m(at_s) @ TURN
    swing = 2.0 * np.array(MOTION.direction) / np.linalg.norm(MOTION.direction) @ TURN
    x, y, z = swing.tolist()
    breath = TissueMoves(
        from_s=0.0,
        until_s=float(at_s[-1]),
        rest_mm=(0.0, 0.0, 0.0),
        swing_mm=(x, y, z),
        covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
        period_s=4.0,
        period_sigma_s=0.01,
        pause_at_s=0.5,
        pause_s=1.4,
    )
    moments = tuple(
        Moment(at_s=float(time_s), tissue=Sighting(value_m=place_m, covariance_m2=1e-10 * np.eye(3)))
        for time_s, place_m in zip(at_s, seen_m, strict=True)
    )
    tissue = CameraTissue(
        watch=SeenScene(moments=moments),
        clock=clock,
        offset=ClockOffset(offset_s=0.0, sigma_s=1e-3),
        breath=breath,
        rotation=None,
    )
    truth_deg = rig.facts.truth_deg
    assert truth_deg is not None
    return KeptSearch(configuration=run.configuration, events=events, tissue=tissue), truth_deg


def test_kept_events_have_no_frames_but_their_headers(kept: tuple[KeptSearch, float]) -> None:
    frames = [event.sample.frame for event in kept[0].events if isinstance(event, Measured)]
    assert frames
    assert all(frame is not None and not hasattr(frame, "channels") for frame in frames)


def test_with_the_rotation_the_marker_is_found_where_it_rests(kept: tuple[KeptSearch, float]) -> None:
    search, truth_deg = kept
    answered = search.answered(CameraRotation(matrix=TURN, sigma_rad=0.02))
    assert answered is not None
    assert isinstance(answered.estimate, Found)
    position = answered.candidates[0].position
    angle = np.radians(truth_deg)
    across = np.array([np.cos(angle), 0.0, -np.sin(angle)]) @ position.position_m
    assert 1e3 * abs(across) < 0.2
    assert 1e3 * abs(position.position_m[1] - LATERAL_M) < 0.2
    assert position.sigma_m[0] < 0.2e-3


def test_a_wrong_rotation_does_not_find_it_there(kept: tuple[KeptSearch, float]) -> None:
    search, _ = kept
    right = search.answered(CameraRotation(matrix=TURN, sigma_rad=0.02))
    turned = Rotation.from_rotvec([0.0, 0.0, 2.5]).as_matrix() @ TURN
    wrong = search.answered(CameraRotation(matrix=turned, sigma_rad=0.02))
    assert right is not None
    assert wrong is not None
    places_m = [each.candidates[0].position.position_m for each in (right, wrong) if each.candidates]
    assert len(places_m) < 2 or 1e3 * np.linalg.norm(np.subtract(*places_m)) > 0.3


def test_a_size_alone_leaves_room_along_the_turn(kept: tuple[KeptSearch, float]) -> None:
    search, truth_deg = kept
    answered = search.answered(None)
    assert answered is not None
    position = answered.candidates[0].position
    angle = np.radians(truth_deg)
    across_m = np.array([np.cos(angle), 0.0, -np.sin(angle)]) @ position.position_m
    turned = search.answered(CameraRotation(matrix=TURN, sigma_rad=0.02))
    assert turned is not None
    assert position.sigma_m[0] > 2 * turned.candidates[0].position.sigma_m[0]
    assert abs(across_m) < 2.5 * position.sigma_m[0]


def test_what_cameras_did_not_see_is_not_answered_again(kept: tuple[KeptSearch, float]) -> None:
    search, _ = kept
    moments = search.tissue.watch.moments
    late = tuple(moment for moment in moments if moment.at_s > moments[-1].at_s - 1.0)
    assert replace(search, tissue=replace(search.tissue, watch=SeenScene(moments=late))).answered(None) is None


def test_a_search_is_answered_again_only_where_more_is_known_of_the_rotation(kept: tuple[KeptSearch, float]) -> None:
    search, truth_deg = kept
    searches = KeptSearches()
    assert searches.is_empty
    asked = mock.Mock(spec=search)
    asked.answered.side_effect = search.answered
    searches.keep("1", asked)
    assert not searches.is_empty
    # Of marker 2, no search is kept: the tissue did not move then.
    markers = [taken("1"), taken("2")]
    rough = CameraRotation(matrix=TURN, sigma_rad=0.1)
    (step,) = searches.corrected(markers, rough)
    assert step.name == "1"
    assert step.answer == "found"
    assert step.candidates[0].angle_deg == pytest.approx(truth_deg, abs=0.5)
    assert f"at {step.candidates[0].angle_deg:.2f} deg" in step.said
    assert list(searches.corrected(markers, replace(rough, sigma_rad=0.09))) == []
    assert list(searches.corrected(markers, rough)) == []
    assert asked.answered.call_count == 1
    better = replace(rough, sigma_rad=0.05)
    (again,) = searches.corrected(markers, better)
    turned = replace(better, matrix=Rotation.from_rotvec([0.0, 0.0, 0.02]).as_matrix() @ TURN)
    assert len(list(searches.corrected(markers, turned))) == 1
    assert again.name == "1"
    assert asked.answered.call_args_list == [mock.call(rough), mock.call(better), mock.call(turned)]


def test_a_marker_that_is_answered_again_has_the_new_answer_and_its_own_spot() -> None:
    candidate = MarkerCandidate(
        angle_deg=3.0,
        probability=1.0,
        position=MarkerPosition(position_m=(1e-3, 2e-3, 6e-2), sigma_m=(1e-4, 1e-4, 1e-4)),
    )
    spot = {"camera_covariance_m2": (1e-8 * np.eye(3)).tolist()}
    step = CorrectedMarker(name="1", answer="found", reason=None, candidates=[candidate], said="marker 1 again: found")
    view = SessionView().after(taken("1", **spot)).after(taken("2", **spot)).after(step)
    assert [marker.answer for marker in view.markers] == ["found", "not found"]
    assert view.markers[0] == structs.replace(taken("1", **spot), answer="found", candidates=[candidate])
    with pytest.raises(RecordError, match="marker 3 is corrected, which is not recorded"):
        view.after(structs.replace(step, name="3"))
