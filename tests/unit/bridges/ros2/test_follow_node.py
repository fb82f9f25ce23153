"""What a run that follows shows on ROS 2, without ROS and without a network."""

from __future__ import annotations

import json
import math
import threading
import time
from types import SimpleNamespace

import pytest
from msgspec import structs

from markerseek.bridges import follow_feed
from markerseek.bridges.ros2 import FollowNode
from markerseek.following import FollowStep
from markerseek.ros import messages, topics

STEP = FollowStep(
    at_s=1.0,
    word="there",
    said="there: the target is 0.2 deg from the image plane",
    probe_deg=10.0,
    target_deg=10.2,
    sigma_deg=0.3,
    within_deg=1.0,
    turning=False,
    davinci_to_trus=[[0.0, -1.0, 0.0, 0.01], [1.0, 0.0, 0.0, -0.02], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]],
    tre_m=0.7e-3,
)


class Node:
    """Keeps what is published, and hands on what is subscribed."""

    def __init__(self):
        self.sent = {}
        self.heard = {}
        self.spun = threading.Semaphore(0)

    def now_s(self):
        return 5.0

    def advertise(self, topic, kind, *, latched=False):
        self.sent[topic] = []

    def publish(self, topic, message):
        self.sent[topic].append(message)

    def subscribe(self, topic, kind, callback, *, command):
        self.heard[topic] = callback

    def spin(self, timeout_s):
        time.sleep(min(timeout_s, 0.01))
        self.spun.release()

    def said(self, topic):
        return [json.loads(each.data) for each in self.sent[topic]]


@pytest.fixture(autouse=True)
def _plain_messages(monkeypatch):
    """Each message is a namespace with its fields."""
    monkeypatch.setattr(messages, "kind", lambda _name: SimpleNamespace)
    monkeypatch.setattr(messages, "is_installed", lambda _name: True)


def shown(*steps, publishes_angle=True):
    """The node after each step was published at least once, and after it was closed; and who asked for a stop."""
    node = Node()
    stops = []
    served = FollowNode(node, simulated=True, publishes_angle=publishes_angle, on_stop=stops.append)
    for step in steps:
        served.show(step)
        seen = len(node.sent[topics.FOLLOW_STATE])
        while len(node.sent[topics.FOLLOW_STATE]) < seen + 2:
            assert node.spun.acquire(timeout=10)
    node.heard[topics.FOLLOW_STOP](None)
    served.close()
    served.close()
    return node, stops


def test_the_transform_is_sent_while_it_holds_and_is_withdrawn_at_the_end():
    node, stops = shown(STEP)
    frames = [each.transforms for each in node.sent[topics.FRAMES]]
    camera, probe = frames[0]
    assert (camera.header.frame_id, camera.child_frame_id) == ("trus_home", "simulated_davinci_camera_optical")
    place = camera.transform.translation
    assert (place.x, place.y, place.z) == pytest.approx((0.01, -0.02, 0.1))
    turn = camera.transform.rotation
    # A quarter turn about z.
    assert (turn.x, turn.y, abs(turn.z), turn.w) == pytest.approx((0, 0, math.sqrt(0.5), math.sqrt(0.5)))
    assert 2 * math.degrees(math.asin(probe.transform.rotation.y)) == pytest.approx(10.0)
    states = node.said(topics.REGISTRATION_STATE)
    # Only where something has changed, however often it is sent.
    assert [each for each in states if each["decided"]] == [
        {"simulated": True, "decided": True, "session": "following", "said": STEP.said, "tre_m": 0.7e-3}
    ]
    assert states[-1]["decided"] is False
    assert math.isnan(node.sent[topics.REGISTRATION][-1].transform.translation.x)
    assert node.said(topics.FOLLOW_STATE)[-1]["word"] == "silent"
    assert stops == ["a message on /pa_follow/stop"]


def test_what_does_not_hold_is_on_no_tf():
    refuted = structs.replace(STEP, word="tissue", said="the tissue has moved", davinci_to_trus=None, tre_m=None)
    node, _ = shown(STEP, refuted, publishes_angle=False)
    states = node.said(topics.REGISTRATION_STATE)
    assert [(each["decided"], "tre_m" in each) for each in states[-3:]] == [
        (True, True),
        (False, False),
        (False, False),
    ]
    assert states[-2]["said"] == "the tissue has moved"
    sent = node.said(topics.FOLLOW_STATE)
    held = sum(each["holds"] for each in sent)
    assert len(node.sent[topics.FRAMES]) == held > 0
    assert topics.MEASURED_JS not in node.sent


def test_a_run_that_says_nothing_is_withdrawn(monkeypatch):
    monkeypatch.setattr(follow_feed, "SILENT_S", 0.0)
    feed = follow_feed.FollowFeed(simulated=False)
    feed.show(STEP)
    time.sleep(0.001)
    assert feed.step is None
