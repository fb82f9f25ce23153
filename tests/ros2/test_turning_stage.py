"""A stage node in another process: its angles while its stage turns, a clock that jumps, and what CRTK asks for."""

from __future__ import annotations

import math
import shutil
import struct
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Client, Start

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.core import Interval, MoveError
from markerseek.drivers import Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.ros import RosNode, topics

HERE = Path(__file__).parent


@pytest.mark.real_time
@pytest.mark.parametrize("jump_s", [-3600.0, -30.0, 30.0])
def test_item_4_no_jump_of_the_clock_ends_a_move_or_leaves_the_node_mute(
    start: Start, node: RosNode, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler, to set the clock of one process")
    shim = tmp_path / "shifted_clock.so"
    clock = tmp_path / "clock"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", shim, HERE / "shifted_clock.c"], check=True)
    clock.write_bytes(struct.pack("d", 0.0))
    with monkeypatch.context() as patched:
        patched.setenv("LD_PRELOAD", str(shim))
        patched.setenv("SHIFTED_CLOCK", str(clock))
        start(*MARKERSEEK, "ros2", "sim", "--pace", "1")
    client = Client(node)
    target_deg = client.angle_deg + (5.0 if client.angle_deg < 0 else -5.0)
    client.send(topics.MOVE_JP, target_deg)
    client.until(lambda: client.states[-1]["is_busy"])
    with clock.open("r+b") as file:
        file.write(struct.pack("d", jump_s))
    client.clock_ahead_s = jump_s
    client.rest()
    assert client.angle_deg == pytest.approx(target_deg, abs=0.01)
    # It is neither mute nor deaf: an angle every 0.1 s, and the next command is carried out.
    client.angles.clear()
    client.wait(1.0)
    assert len(client.angles) >= 5
    client.go(target_deg + 1.0)


@pytest.mark.real_time
@pytest.mark.parametrize("emulated", [False, True], ids=["simulated", "KDC101 emulator"])
def test_item_12_the_angle_comes_at_least_twenty_times_a_second_while_the_stage_turns(
    start: Start, node: RosNode, tmp_path: Path, emulated: bool
) -> None:
    if emulated:
        emulator = start(*MARKERSEEK, "emulate", "bench", "--dir", tmp_path / "bench", wait=False)
        next(line for line in emulator.stdout if "Ctrl-C ends it" in line)
        start(*MARKERSEEK, "ros2", "stage", "--rig", tmp_path / "bench" / "rig.toml", "--arm")
    else:
        start(*MARKERSEEK, "ros2", "sim", "--pace", "1")
    client = Client(node)
    from_deg = client.angle_deg
    target_deg = from_deg + 20.0 if from_deg < 0 else from_deg - 20.0
    client.go(target_deg)
    turning = [(heard_s, angle) for heard_s, angle in client.angles if 1 < abs(angle - from_deg) < 19]
    assert (len(turning) - 1) / (turning[-1][0] - turning[0][0]) >= 20.0
    # They are angles on its way, and not the last one again.
    assert len({angle for _heard_s, angle in turning}) >= 10


def test_item_5_a_refusal_reaches_the_driver_at_once(start: Start, node: RosNode) -> None:
    start(*MARKERSEEK, "ros2", "sim")
    stage = Ros2Stage(
        node=node,
        clock=SystemClock(),
        settings=Ros2StageSettings(),
        travel=Interval(low_deg=-60.0, high_deg=60.0),
    )
    began_s = time.monotonic()
    with pytest.raises(MoveError, match=r"its node refuses 50.000 deg"):
        stage.move_to(50.0)
    assert time.monotonic() - began_s < 10.0


def test_item_12_frames_setpoint_and_transforms_of_a_stage_node(start: Start, node: RosNode) -> None:
    start(*MARKERSEEK, "ros2", "sim")
    client = Client(node)
    heard: dict[str, list[Any]] = {topics.MEASURED_JS: [], topics.FRAMES: []}
    kinds = "sensor_msgs/msg/JointState", "geometry_msgs/msg/TransformStamped"
    with RosNode("late", network=node.network) as late:
        for topic, kind in zip(heard, kinds, strict=True):
            late.subscribe(topic, kind, heard[topic].append)
        client.go(5.0)
        client.until(lambda: all(heard.values()))
        for each in heard.values():
            each.clear()
        client.until(lambda: all(heard.values()))
        (joint, *_), (turned, *_) = heard.values()
        half = math.radians(client.angle_deg) / 2
        assert joint.header.frame_id == turned.header.frame_id == "trus_home"
        assert turned.child_frame_id == "trus_probe"
        rotation = turned.transform.rotation
        assert (rotation.y, rotation.w) == pytest.approx((math.sin(half), math.cos(half)), abs=1e-6)
        # Who comes late is told at once where the stage was sent to: the topic is latched.
        setpoints: list[Any] = []
        late.subscribe(topics.SETPOINT_JS, "sensor_msgs/msg/JointState", setpoints.append, latched=True)
        client.until(lambda: bool(setpoints))
        assert math.degrees(setpoints[0].position[0]) == pytest.approx(5.0)
