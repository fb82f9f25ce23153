"""The stage node as CRTK has it: refusals, frames, setpoint."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.core import Interval, MoveError
from markerseek.drivers import Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.ros import RosNode, topics
from tests.ros2.turning import Client


@pytest.fixture
def node() -> Iterator[RosNode]:
    with RosNode("client") as made:
        yield made


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
