"""``markerseek ros2 follow``: the transform on ``/tf`` while it follows, its validity, the state, and a stop."""

from __future__ import annotations

import time

import numpy as np
import pytest

from markerseek.ros import RosNode, messages, topics
from tests.ros2.heard import LISTENER, Heard, state
from tests.ros2.ros_processes import MARKERSEEK, Start

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

FOLLOW = (*MARKERSEEK, "ros2", "follow", "--simulate", "--pace", "1")


def word(*words: str):
    """Whether the run stands so."""
    return lambda message: message["topic"] == "follow" and message["word"] in words


def test_the_transform_is_on_tf_while_it_follows_and_is_withdrawn_when_it_ends(start: Start) -> None:
    heard = Heard(start(*LISTENER))
    run = start(*FOLLOW, "--seconds", "6", "--json")
    known = heard.until(state(decided=True, simulated=True, session="following"), word("there"))
    assert any("tre_m" in each for each in known if each["topic"] == "state")
    came = known + heard.until(state(decided=False), word("silent"))
    cameras = [
        each
        for each in came
        if each["topic"] == "tf" and each["frames"] == ["trus_home", "simulated_davinci_camera_optical"]
    ]
    assert cameras
    assert all(each["age_s"] < 5 for each in cameras)
    # Nothing in the simulated room moves the endoscope.
    assert np.ptp([each["place_m"] for each in cameras], axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    turned = {each["quaternion"][1] for each in came if each["topic"] == "tf" and each["frames"][1] == "trus_probe"}
    assert len(turned) > 5
    stamps = sorted(each["stamp_s"] for each in cameras)
    # Twelve a second; on a busy computer many are late.
    assert np.median(np.diff(stamps)) <= 0.15
    latched = [each for each in came if each["topic"] == "registration"]
    assert np.isnan([*latched[-1]["place_m"], *latched[-1]["quaternion"]]).all()
    assert run.wait(timeout=90) == 0


def test_a_stop_holds_the_probe_until_a_person_comes(start: Start, node: RosNode) -> None:
    heard = Heard(start(*LISTENER))
    run = start(*FOLLOW, "--seconds", "60")
    heard.until(word("there", "turning"))
    node.advertise(topics.FOLLOW_STOP, "std_msgs/msg/Empty")
    ends_s = time.monotonic() + 20
    while not node.matched(topics.FOLLOW_STOP):
        assert time.monotonic() < ends_s
        node.spin(0.05)
    node.publish(topics.FOLLOW_STOP, messages.empty())
    heard.until(word("stopped", "silent"))
    said, _ = run.communicate(timeout=90)
    assert "stopped by a message on /pa_follow/stop" in " ".join(said.split())
    assert run.returncode == 3


def test_a_second_publisher_of_the_transform_is_refused(start: Start) -> None:
    start(*FOLLOW, "--seconds", "300")
    second = start(*FOLLOW, "--seconds", "5", wait=False)
    said, _ = second.communicate(timeout=150)
    assert second.returncode == 2
    assert "publish /pa_search/registration" in " ".join(said.split())
