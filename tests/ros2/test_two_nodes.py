"""Two nodes that would do the same work, nodes that are killed, and the arguments that every program of ROS 2 takes."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Client, Start, call

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.core import ConfigError, NotConnectedError, Permit
from markerseek.drivers import Ros2Acquisition, Ros2ReceiverSettings, Ros2Stage, Ros2StageSettings, SystemClock
from markerseek.guard import Limits
from markerseek.ros import RosNode, topics

TEXT = "std_msgs/msg/String"
SEARCH = (*MARKERSEEK, "ros2", "search", "--method", "ternary", "--acquisitions", "5")
NOTICED_S = 4.0
"""2 s are promised; the others are for a busy computer."""


def refusal_of(*words: object) -> str:
    """What a command says that ends with exit code 2."""
    done = subprocess.run(
        [*map(str, words)], check=False, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=60
    )
    assert done.returncode == 2, done
    return " ".join(done.stderr.split())


def test_item_6_a_second_node_is_refused_by_its_name_and_by_what_it_publishes(start: Start) -> None:
    start(*SEARCH)
    refusal = refusal_of(*SEARCH, "--ros-args", "-r", "__node:=second")
    assert f"1 nodes are named second, and 1 publish {topics.RESULT}" in refusal
    with RosNode("pa_search") as twin, pytest.raises(ConfigError, match="2 nodes are named pa_search"):
        twin.require_alone(topics.RESULT)


def test_item_6_a_node_takes_the_arguments_of_ros(start: Start, node: RosNode) -> None:
    start(*SEARCH)
    arguments = ["--ros-args", "-r", "__ns:=/left", "-r", "pa_search/intensity:=brightness", "--"]
    start(*SEARCH[:-4], *arguments, *SEARCH[-4:])
    heard: dict[str, list[Any]] = {"/left/pa_search/result": [], "/left/brightness": [], topics.RESULT: []}
    for topic, kind in zip(heard, (TEXT, "std_msgs/msg/Float64", TEXT), strict=True):
        node.subscribe(topic, kind, heard[topic].append, latched=kind == TEXT)

    def states(topic: str) -> list[str]:
        return [json.loads(each.data)["state"] for each in heard[topic]]

    ends_s = time.monotonic() + 60
    assert call(node, "/left/pa_search/run", timeout_s=20)[0]
    while "ended" not in states("/left/pa_search/result") or not heard["/left/brightness"]:
        assert time.monotonic() < ends_s, heard
        node.spin(0.05)
    # The other one, without a namespace, did not hear of it.
    assert states(topics.RESULT) == ["idle"]


def test_item_6_wrong_arguments_of_ros_are_named() -> None:
    assert "['--bogus']" in refusal_of(*SEARCH, "--ros-args", "--bogus")


def test_item_4_the_time_of_a_rig_cannot_be_taken_from_a_topic() -> None:
    assert "use_sim_time is true" in refusal_of(*MARKERSEEK, "ros2", "sim", "--ros-args", "-p", "use_sim_time:=true")


@pytest.mark.real_time
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGSTOP])
def test_item_9_a_stage_node_that_is_killed_or_frozen_is_noticed_within_two_seconds(
    start: Start, node: RosNode, sent: signal.Signals
) -> None:
    nodes = start(*MARKERSEEK, "ros2", "sim", "--pace", "1")
    client = Client(node)
    done_s: list[float] = []

    def kill() -> None:
        if not done_s and client.states[-1]["is_busy"]:
            nodes.send_signal(sent)
            done_s.append(time.monotonic())

    with RosNode("markerseek_rig", network=node.network) as rig:
        stage = Ros2Stage(node=rig, clock=SystemClock(beat=kill), settings=Ros2StageSettings(), travel=Limits().search)
        with pytest.raises(NotConnectedError, match="its node is gone: nobody publishes /TRUS/measured_js any more"):
            stage.move_to(30.0 if client.angle_deg < 0 else -30.0)
    assert time.monotonic() - done_s[0] <= NOTICED_S
    nodes.send_signal(signal.SIGCONT)


@pytest.mark.real_time
def test_item_9_an_acquisition_node_that_is_killed_is_noticed_within_two_seconds(start: Start, node: RosNode) -> None:
    nodes = start(*MARKERSEEK, "ros2", "sim", "--pace", "1")
    clock = SystemClock()
    acquisition = Ros2Acquisition(node=node, clock=clock, settings=Ros2ReceiverSettings())
    permit = Permit(token="1", angle_deg=0.0, pulses=16, expires_s=clock.now_s() + 5.0)
    acquisition.arm(permit)
    nodes.send_signal(signal.SIGKILL)
    killed_s = time.monotonic()
    with pytest.raises(NotConnectedError, match="its node is gone: nobody publishes /TRUS/pa/acquired any more"):
        acquisition.fire(permit)
    assert time.monotonic() - killed_s <= NOTICED_S
