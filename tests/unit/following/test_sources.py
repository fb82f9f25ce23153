"""Tips of a robot, poses as they are read, a fixed point, and a simulated spot that the cameras see."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError
from markerseek.drivers import open_poses
from markerseek.drivers.poses import Pose, pose_matrix
from markerseek.following import (
    FixedPoint,
    FollowedRoom,
    FollowPlan,
    HeldRegistration,
    RobotTip,
    SimulatedSpot,
    TargetPath,
)
from markerseek.registration import SimulatedRoomSettings
from markerseek.sim import STREAMING, VirtualClock
from tests.faults.followed_runs import CAMERA_TO_TRUS, registration


class Poses:
    """Poses that a test sets."""

    name = "a test"

    def __init__(self) -> None:
        self.next: Pose | None = None

    def read(self) -> Pose | None:
        return self.next

    def close(self) -> None:
        pass


def tip_of(
    poses: Poses, clock: VirtualClock, offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[RobotTip, list[str]]:
    """A tip, and what it notes."""
    notes: list[str] = []
    return RobotTip(poses, clock, offset_mm=offset_mm, on_note=notes.append), notes


def test_the_tip_is_the_offset_in_the_reported_frame() -> None:
    poses = Poses()
    clock = VirtualClock()
    tip, _ = tip_of(poses, clock, (0.0, 0.0, 10.0))
    matrix = np.eye(4)
    # The tool points along x of the camera after a turn by 90 deg about y.
    matrix[:3, :3] = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    matrix[:3, 3] = 1.0, 2.0, 100.0
    poses.next = Pose(matrix=matrix, stamp_s=1000.0)
    clock.wait(3.0)
    target = tip.newest()
    assert target is not None
    assert 1e3 * target.camera_m == pytest.approx([11.0, 2.0, 100.0])
    assert target.at_s == tip.heard_s == 3.0


def test_what_the_arm_is_off_by_counts_where_it_is_stated_and_is_said_where_it_is_not() -> None:
    poses = Poses()
    clock = VirtualClock()
    poses.next = Pose(matrix=np.eye(4), stamp_s=None)
    plain, _ = tip_of(poses, clock)
    stated = RobotTip(poses, clock, offset_mm=(0.0, 0.0, 0.0), sigma_mm=1.5, on_note=lambda _said: None)
    (arm,) = plain.links.not_counted
    assert "base frame" in arm
    assert stated.links.not_counted == ()
    assert "± 1.5 mm" in stated.links.counted[-1]
    target = stated.newest()
    assert target is not None
    assert target.shared_m2 == pytest.approx(np.eye(3) * 1.5e-3**2)
    held = HeldRegistration(registration(CAMERA_TO_TRUS), confirmed=True)
    far = replace(target, camera_m=CAMERA_TO_TRUS.inverse().apply(np.array([0.0, 0.0, 0.06])))
    with_arm, without = held.aim(far), held.aim(replace(far, shared_m2=None))
    # An angle of 1.5 mm at 60 mm from the axis more; from one time to the next nothing more.
    more_deg = math.degrees(1.5 / 60)
    assert with_arm.sigma_deg == pytest.approx(math.hypot(without.sigma_deg, more_deg))
    assert (with_arm.noise_m2 == without.noise_m2).all()
    with pytest.raises(ConfigError, match=r"sigma_mm is 21 mm, it must lie in \[0, 20\] mm"):
        RobotTip(poses, clock, offset_mm=(0.0, 0.0, 0.0), sigma_mm=21, on_note=lambda _said: None)


def test_a_pose_that_is_not_valid_was_heard_and_a_silent_link_was_not() -> None:
    poses = Poses()
    clock = VirtualClock()
    tip, _ = tip_of(poses, clock)
    clock.wait(1.0)
    poses.next = Pose(matrix=None, stamp_s=7.0)
    assert tip.newest() is None
    assert tip.heard_s == 1.0
    clock.wait(1.0)
    poses.next = None
    assert tip.newest() is None
    assert tip.heard_s == 1.0


@pytest.mark.parametrize("stamp_s", [1000.0, 999.0])
def test_a_pose_whose_time_does_not_advance_is_not_heard(stamp_s: float) -> None:
    poses = Poses()
    clock = VirtualClock()
    tip, notes = tip_of(poses, clock)
    clock.wait(1.0)
    poses.next = Pose(matrix=np.eye(4), stamp_s=1000.0)
    assert tip.newest() is not None
    for _ in range(5):
        clock.wait(0.05)
        poses.next = Pose(matrix=np.eye(4), stamp_s=stamp_s)
        assert tip.newest() is None
    assert tip.heard_s == pytest.approx(1.0)
    poses.next = Pose(matrix=np.eye(4), stamp_s=1000.25)
    target = tip.newest()
    assert target is not None
    assert target.at_s == tip.heard_s == pytest.approx(1.25)
    assert notes == []


def test_a_message_that_comes_late_is_as_old_as_its_stamp_says() -> None:
    poses = Poses()
    clock = VirtualClock()
    poses.next = Pose(matrix=np.eye(4), stamp_s=1000.0)
    # The sender's clock is 1000 s ahead; the first message comes when the link is opened.
    tip, _ = tip_of(poses, clock)
    clock.wait(60.0)
    poses.next = Pose(matrix=np.eye(4), stamp_s=1000.1)
    target = tip.newest()
    assert target is not None
    assert target.at_s == tip.heard_s == pytest.approx(0.1)


def test_a_link_without_times_says_so_once() -> None:
    poses = Poses()
    clock = VirtualClock()
    poses.next = Pose(matrix=np.eye(4), stamp_s=None)
    tip, notes = tip_of(poses, clock)
    for now_s in (1.0, 2.0, 3.0):
        clock.wait(1.0)
        assert tip.newest() is not None
        assert tip.heard_s == now_s
    assert notes == ["the tip by a test: its messages have no time, so that an old pose sent again is not noticed"]


def message(kind: str, turn: tuple[float, ...], place: tuple[float, ...]) -> Any:
    """A message of ROS 2, as its fields."""
    x, y, z, w = turn
    rotation = SimpleNamespace(x=x, y=y, z=z, w=w)
    position = SimpleNamespace(x=place[0], y=place[1], z=place[2])
    if kind == "pose":
        return SimpleNamespace(pose=SimpleNamespace(position=position, orientation=rotation))
    return SimpleNamespace(transform=SimpleNamespace(translation=position, rotation=rotation))


@pytest.mark.parametrize("kind", ["pose", "transform"])
def test_a_pose_of_ros_is_a_matrix_in_millimetres(kind: str) -> None:
    half = math.sqrt(0.5)
    matrix = pose_matrix(message(kind, (0.0, 0.0, half, half), (0.01, 0.0, -0.2)))
    assert matrix is not None
    # A quarter turn about z takes x to y.
    assert matrix @ [1, 0, 0, 1] == pytest.approx([10.0, 1.0, -200.0, 1.0])
    assert pose_matrix(message(kind, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))) is None
    assert pose_matrix(message(kind, (0.0, 0.0, 0.0, 1.0), (math.nan, 0.0, 0.0))) is None


@pytest.mark.parametrize("where", ["", "psm1", "localhost:99999/PSM1", "localhost/PSM1", "localhost:18944"])
def test_what_names_no_poses_is_refused(where: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        open_poses(where, VirtualClock())
    assert str(refusal.value) == (
        f"poses: {where} is no place; name topic:/PSM1/measured_cp of ROS 2, or HOST:PORT/DEVICE"
    )


def test_a_point_stays_where_it_is() -> None:
    clock = VirtualClock()
    point = FixedPoint(clock, camera_mm=(4.0, -12.0, 105.0))
    clock.wait(2.0)
    assert 1e3 * point.newest().camera_m == pytest.approx([4.0, -12.0, 105.0])
    assert point.newest().at_s == point.heard_s == 2.0
    with pytest.raises(ConfigError, match="its coordinates must be finite"):
        FixedPoint(clock, camera_mm=(math.inf, 0.0, 0.0))


def test_a_spot_is_seen_where_it_is_and_heard_below_it() -> None:
    room = FollowedRoom(SimulatedRoomSettings(rig=STREAMING), TargetPath(motion="still"), seed=4)
    scanner = room.rig.scanner
    plan = FollowPlan()
    scanner.begin_following(plan.permit(scanner.limits.search, lit=True), by="a test")
    look = SimulatedSpot(room).look(plan.pulses)
    assert look.target is not None
    true_m = room.target_m(scanner.clock.now_s())
    assert true_m is not None
    error_m = look.target.camera_m - true_m
    # Within three of its own standard deviations along each axis, and 1 % of focal length and base in depth.
    sigma_m = np.sqrt(np.diag(look.target.covariance_m2))
    assert (np.abs(error_m) <= 4 * sigma_m + 0.02 * np.abs(look.target.camera_m)).all()
    assert look.sample is not None
    assert look.sample.reading.lateral_m == pytest.approx(0.0, abs=1.5e-3)
    room.path = TargetPath(motion="lost")
    scanner.clock.wait(6.0)
    gone = SimulatedSpot(room).look(plan.pulses)
    assert gone.target is None
    assert gone.reason == "no light is seen in the images"


@pytest.mark.parametrize("motion", ["still", "sine", "steps", "jump"])
def test_a_simulated_registration_is_off_by_its_error(motion: str) -> None:
    errors_m = []
    for seed in range(12):
        path = TargetPath(motion=motion)  # type: ignore[arg-type]
        room = FollowedRoom(SimulatedRoomSettings(rig=STREAMING), path, seed=seed)
        known = room.registration(error_m=0.5e-3)
        middle_m = np.array([0.0, 0.0, 0.06])
        errors_m.append(known.davinci_to_trus.apply(room.true.inverse().apply(middle_m)) - middle_m)
        assert known.report.tre_m == 0.5e-3
    # The root mean square of 36 coordinates is within 35 % of the true one in all but 1 of 400 draws.
    assert np.sqrt(np.sum(np.square(errors_m), axis=1).mean()) == pytest.approx(0.5e-3, rel=0.35)
