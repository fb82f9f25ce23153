"""A place that a person points at: the probe turns there once, whatever the endoscope does then; and its record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import ConfigError, Interval, RecordError
from markerseek.following import (
    Aim,
    FollowBegun,
    FollowedRoom,
    FollowEnded,
    Follower,
    FollowMachine,
    FollowPlan,
    FollowRecord,
    FollowStep,
    HeldRegistration,
    NewestPairs,
    PointedPlace,
    ProbeReach,
    TargetPath,
    follow_record,
    probe_reach,
)
from markerseek.registration import EndoscopeMotion, SimulatedRoomSettings
from markerseek.sim import STREAMING

PLACES_PX = (700.0, 480.0), (560.0, 500.0)
BORDER_PX = 10.0, 500.0


def room() -> FollowedRoom:
    made = FollowedRoom(SimulatedRoomSettings(rig=STREAMING, textured=True), TargetPath(motion="still"), seed=1)
    made.rig.scanner.clock.wait(1.0)
    return made


def follow(
    made: FollowedRoom, clicks: dict[float, tuple[float, float]], *, until_s: float
) -> tuple[list[FollowStep], PointedPlace]:
    """Steps of a run in which a person points at places at times after the begin."""
    clock = made.rig.scanner.clock
    begun_s = clock.now_s()
    waiting = {begun_s + at_s: pixel for at_s, pixel in clicks.items()}

    def pointed() -> tuple[float, float] | None:
        due = [at_s for at_s in waiting if at_s <= clock.now_s()]
        return waiting.pop(due[0]) if due else None

    source = PointedPlace(NewestPairs(made.images), made.stereo, clock, left_px=PLACES_PX[0], pointed=pointed)
    held = HeldRegistration(made.registration(error_m=0.0), confirmed=True)
    follower = Follower(made.rig, held, source, plan=FollowPlan(), by="a test", reach=probe_reach(made.rig))
    steps = []
    running = follower.steps()
    for step in running:
        steps.append(step)
        if step.at_s >= begun_s + until_s:
            break
    running.close()
    return steps, source


def test_the_probe_turns_to_the_place_and_to_another_one_that_is_no_jump() -> None:
    made = room()
    steps, source = follow(made, {6.0: PLACES_PX[1]}, until_s=14.0)
    assert {step.word for step in steps} <= {"waiting", "turning", "resting", "there"}
    middle = [step for step in steps if step.at_s - steps[0].at_s < 6.0][-1]
    for step, left_px in ((middle, PLACES_PX[0]), (steps[-1], PLACES_PX[1])):
        assert step.word == "there"
        # Matched by its texture to 0.1 px, with a calibration that is off as it says.
        assert step.probe_deg == pytest.approx(made.angle_at_deg(left_px), abs=1.0)
        # To its plane, and not to the edge of the range.
        assert step.probe_deg == pytest.approx(step.target_deg, abs=0.2)
        left = made.stereo.cameras.project(np.array(step.target_camera_m)[None])[0][0]
        assert left.tolist() == pytest.approx(left_px, abs=0.01)
    assert source.left_px == PLACES_PX[1]
    assert source.name.startswith("the place at 560, 500 of the left image, 10")
    assert source.name.endswith(" mm deep")


def test_a_place_without_enough_texture_is_refused_and_the_former_one_is_followed_on() -> None:
    steps, source = follow(room(), {3.0: BORDER_PX}, until_s=8.0)
    assert steps[-1].word == "there"
    assert "which cannot be followed: the place at 10, 500 of the left image is nearer than" in steps[-1].refused
    assert source.left_px == PLACES_PX[0]
    made = room()
    with pytest.raises(ConfigError, match="`pixel` is 10, 500, which cannot be followed"):
        PointedPlace(NewestPairs(made.images), made.stereo, made.rig.scanner.clock, left_px=BORDER_PX)


def test_an_endoscope_that_moves_afterwards_does_not_take_the_place_along() -> None:
    made = room()
    clock = made.rig.scanner.clock
    source = PointedPlace(NewestPairs(made.images), made.stereo, clock, left_px=PLACES_PX[0])
    held = HeldRegistration(made.registration(error_m=0.0), confirmed=True)
    moved = EndoscopeMotion(
        since="1",
        after="1",
        displacement_mm=(4.0, 0.0, 0.0),
        rotation_deg=(0.0, 3.0, 0.0),
        middle_mm=(0.0, 0.0, 100.0),
        covariance=tuple(tuple(row) for row in (1e-4 * np.eye(6)).tolist()),
    )
    follower = Follower(
        made.rig,
        held,
        source,
        plan=FollowPlan(),
        by="a test",
        reach=probe_reach(made.rig),
        endoscope=lambda: moved if clock.now_s() > 6.0 else None,
    )
    steps = []
    running = follower.steps()
    for step in running:
        steps.append(step)
        if step.at_s > 9.0:
            break
    running.close()
    before = [step for step in steps if step.at_s < 6.0][-1]
    assert steps[-1].target_deg == before.target_deg
    assert steps[-1].probe_deg == pytest.approx(before.probe_deg, abs=0.05)
    # The camera as it stands now sees it elsewhere.
    assert np.linalg.norm(np.array(steps[-1].target_camera_m) - before.target_camera_m) > 1e-3


def machine() -> FollowMachine:
    reach = ProbeReach(angles=Interval(low_deg=-35, high_deg=35), lateral_m=20e-3, radius_m=(10e-3, 90e-3))
    return FollowMachine(FollowPlan(), reach, acceleration_deg_s2=25.0, lit=False, begun_s=0.0)


@pytest.mark.parametrize(("named", "word"), [((1, 2), "turning"), ((1, 1), "jumped"), ((None, None), "jumped")])
def test_only_a_place_of_another_number_is_no_jump(named: tuple[int | None, int | None], word: str) -> None:
    made = machine()
    words = []
    for number in range(21):
        at_s = 0.05 * number
        which = named[number // 20]
        place_m = np.array([0.0 if number < 20 else 20e-3, 0.0, 60e-3])
        made.hear(at_s)
        made.see(Aim(at_s=at_s, trus_m=place_m, covariance_m2=1e-8 * np.eye(3), noise_m2=np.zeros((3, 3)), named=which))
        words.append(made.decide(at_s, probe_deg=0.0).word)
    assert words[-2:] == ["there", word]


STEP = FollowStep(
    at_s=1.0,
    word="there",
    said="there",
    probe_deg=1.0,
    target_deg=1.5,
    sigma_deg=0.2,
    within_deg=1.0,
    turning=False,
    davinci_to_trus=None,
    tre_m=None,
)
BEGUN = FollowBegun(
    what="a tip", rig="a rig", simulated=True, registration="", plan=FollowPlan(), lit=False, by="a test", begun=""
)


def lines_of(path: Path) -> list[object]:
    return list(follow_record(path, is_over=lambda: True, wait=lambda: None))


def test_a_record_gives_its_steps_back_and_leaves_out_what_says_nothing_new(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    record = FollowRecord.create(path, BEGUN)
    soon = structs.replace(STEP, at_s=1.05)
    turning = structs.replace(STEP, at_s=1.06, word="turning", turning=True)
    later = structs.replace(turning, at_s=1.2)
    for step in (STEP, soon, turning, later):
        record.add(step)
    assert lines_of(path) == [BEGUN, STEP, turning, later]
    record.end("over")
    record.close()
    assert lines_of(path)[-1] == FollowEnded(said="over")
    with pytest.raises(RecordError, match="it is there already"):
        FollowRecord.create(path, BEGUN)


def test_a_record_that_was_changed_or_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    record = FollowRecord.create(path, BEGUN)
    record.add(STEP)
    record.add(structs.replace(STEP, at_s=2.0))
    record.close()
    path.write_bytes(path.read_bytes().replace(b'"probe_deg":1.0', b'"probe_deg":9.0', 1))
    with pytest.raises(RecordError, match="does not agree with its checksum"):
        lines_of(path)
    assert lines_of(tmp_path / "none.jsonl") == []
