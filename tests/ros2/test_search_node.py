"""The search node: its services, its topics, its answer, and how it ends."""

from __future__ import annotations

import json
import math
import os
import select
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.ros2.ros_processes import MARKERSEEK, Start, answer_of, call

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.ros import RosNode, topics
from markerseek.ros.messages import stamp_ns, time_ns

TEXT = "std_msgs/msg/String"
SEARCH = ("--method", "ternary", "--acquisitions", "5", "--seed", "2")


class Listener:
    """A client of the search node, with all that it heard."""

    def __init__(self, node: RosNode) -> None:
        self.node = node
        self.heard: dict[str, list[Any]] = {}
        for topic, kind, latched in (
            (topics.RESULT, TEXT, True),
            (topics.BANK, TEXT, True),
            (topics.SAMPLE, TEXT, False),
            (topics.INTENSITY, "std_msgs/msg/Float64", False),
            (topics.MEASURED_JS, "sensor_msgs/msg/JointState", False),
            (topics.ENVELOPE, "sensor_msgs/msg/Image", False),
            (topics.PICTURE, "sensor_msgs/msg/Image", False),
        ):
            self.heard[topic] = []
            node.subscribe(topic, kind, self.heard[topic].append, latched=latched)

    def drain(self) -> None:
        """Take what is still on its way: topics are not in step with one another."""
        silent = 0
        for _ in range(200):
            before = self.node.network.handled
            self.node.spin(0.1)
            silent = silent + 1 if self.node.network.handled == before else 0
            if silent == 4:
                return

    def wait_for(self, state: str) -> dict[str, Any]:
        for _ in range(3000):
            self.node.spin(0.05)
            results = [json.loads(each.data) for each in self.heard[topics.RESULT]]
            # Every publisher must have been found: what it sends before that does not arrive.
            if results and results[-1]["state"] == state and all(map(self.node.publishes, self.heard)):
                self.drain()
                return results[-1]
        raise AssertionError(f"the search never was {state}")

    def match(self) -> None:
        """Have searches made until every topic was heard, then forget them.

        A publisher sends nothing to a listener that it has not found yet, whatever the listener has found.
        """
        self.wait_for("idle")
        for _ in range(10):
            self.heard[topics.RESULT].clear()
            assert call(self.node, topics.RUN, timeout_s=10)[0]
            self.wait_for("ended")
            if all(self.heard.values()):
                break
        for messages in self.heard.values():
            messages.clear()


@pytest.fixture
def listener() -> Iterator[Listener]:
    with RosNode("listener") as node:
        yield Listener(node)


def test_a_search_that_is_asked_for_gives_the_answer_of_the_command(start: Start, listener: Listener) -> None:
    start(*MARKERSEEK, "ros2", "search", *SEARCH)
    listener.match()
    # What the searches before have sent can still come, up to a heartbeat of the middleware later.
    began_s = listener.node.now_s()
    accepted, sentence = call(listener.node, topics.RUN, timeout_s=10)
    assert accepted
    assert topics.RESULT in sentence
    refused, sentence = call(listener.node, topics.RUN, timeout_s=10)
    assert not refused
    assert sentence == "a search is running; stop it, or wait for its end"
    ended = listener.wait_for("ended")
    code, alone = answer_of("search", *SEARCH, "--no-journal", "--json")
    assert ended["exit_code"] == code
    assert ended["result"] == alone
    # Topics are not delivered in the order in which they were published.
    ends_s = time.monotonic() + 60
    searched: list[dict[str, Any]] = []
    angles_rad: dict[int, float] = {}
    while len(angles_rad) < len(alone["samples"]) and time.monotonic() < ends_s:
        listener.node.spin(0.05)
        samples = [json.loads(each.data) for each in listener.heard[topics.SAMPLE]]
        searched = [each for each in samples if each["time_s"] >= began_s and each["role"] == "search"]
        heard_rad = {stamp_ns(each): each.position[0] for each in listener.heard[topics.MEASURED_JS]}
        stamps_ns = [time_ns(each["time_s"]) for each in searched]
        angles_rad = {each: heard_rad[each] for each in stamps_ns if each in heard_rad}
    assert [each["angle_deg"] for each in searched] == [each["angle_deg"] for each in alone["samples"]]
    assert [each["intensity"] for each in searched] == [each["intensity"] for each in alone["samples"]]
    expected = [math.radians(each["angle_deg"]) for each in searched]
    assert [angles_rad[each] for each in stamps_ns] == pytest.approx(expected)
    known = json.loads(listener.heard[topics.BANK][-1].data)
    assert known["facts"]["kind"] == "simulated"
    assert "recipe" not in known
    assert listener.heard[topics.ENVELOPE][-1].encoding == "32FC1"
    pictures = listener.heard[topics.PICTURE]
    # White is the brightest of the search so far.
    assert max(max(each.data) for each in pictures) == 255
    assert all(len(each.data) == each.height * each.width for each in pictures)
    # Latched: who comes later gets the answer too.
    with RosNode("late") as node:
        late = Listener(node)
        assert late.wait_for("ended") == ended


def test_a_search_is_cancelled_and_the_next_may_begin(start: Start, listener: Listener) -> None:
    start(*MARKERSEEK, "ros2", "search", *SEARCH, "--pace", "0.1")
    listener.wait_for("idle")
    assert call(listener.node, topics.CANCEL, timeout_s=10) == (False, "no search is running")
    call(listener.node, topics.RUN, timeout_s=10)
    while not listener.heard[topics.SAMPLE]:
        listener.node.spin(0.05)
    assert call(listener.node, topics.CANCEL, timeout_s=10) == (True, "the search is being stopped")
    ended = listener.wait_for("ended")
    # SIGTERM comes after two seconds where SIGINT is ignored, as in what a script starts in the background.
    assert ended["exit_code"] in (130, 143)
    assert ended["message"].startswith("stopped by ")
    assert call(listener.node, topics.RUN, timeout_s=10)[0]


def test_nobody_at_the_terminal_of_the_search_node_means_not_armed(
    start: Start, listener: Listener, tmp_path: Any
) -> None:
    rig = tmp_path / "rig.toml"
    start(*MARKERSEEK, "ros2", "sim", "--write-rig", rig)
    start(*MARKERSEEK, "ros2", "search", "--rig", rig)
    listener.wait_for("idle")
    call(listener.node, topics.RUN, timeout_s=10)
    ended = listener.wait_for("ended")
    assert ended["exit_code"] == 4
    assert ended["message"].startswith("not armed: nothing moved and nothing was fired")
    assert listener.heard[topics.SAMPLE] == []


def test_a_search_node_that_is_killed_takes_its_search_along(start: Start, listener: Listener) -> None:
    node = start(*MARKERSEEK, "ros2", "search", *SEARCH, "--pace", "0.2")
    listener.wait_for("idle")
    call(listener.node, topics.RUN, timeout_s=10)
    child = os.pidfd_open(listener.wait_for("running")["process_id"])
    while not listener.heard[topics.SAMPLE]:
        listener.node.spin(0.05)
    node.send_signal(signal.SIGKILL)
    assert select.select([child], [], [], 30)[0], "the search goes on without the node that was asked for it"
    os.close(child)
