"""What a search shows on ROS 2 of an acquisition, without ROS and without a network."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.bridges.ros2.sample_topics import SampleTopics
from markerseek.core import Measured, SearchPlan, SweepTiming
from markerseek.ros import messages, topics
from markerseek.runs import configuration_of
from tests.pictured import pictured_entry


class Node:
    """Keeps what is published."""

    def __init__(self):
        self.sent = {}

    def now_s(self):
        return 1.0

    def advertise(self, topic, kind, **how):
        pass

    def publish(self, topic, message):
        self.sent.setdefault(topic, []).append(message)


@pytest.fixture(autouse=True)
def _plain_messages(monkeypatch):
    """Each message is a namespace with its fields."""
    monkeypatch.setattr(messages, "kind", lambda _name: SimpleNamespace)
    monkeypatch.setattr(messages, "is_installed", lambda _name: True)


def published(rig, event, *, publishes_angle=True):
    """What is published of one acquisition of a rig."""
    node = Node()
    shown = SampleTopics(node=node, publishes_angle=publishes_angle)
    configuration = configuration_of(rig, SearchPlan(method="ternary"))
    shown.begin(configuration)
    shown.publish(pictured_entry(configuration, event))
    return node.sent


def test_the_turn_of_the_probe_is_told_by_its_stage_node_where_there_is_one():
    rig = rigs.simulated(seed=1)
    event = Measured(role="search", index=1, sample=rig.scanner.measure(5.0))
    for publishes_angle, told in ((True, ["trus_probe", "trus_image"]), (False, ["trus_image"])):
        sent = published(rig, event, publishes_angle=publishes_angle)
        assert [each.child_frame_id for each in sent[topics.FRAMES][0].transforms] == told
        assert (topics.MEASURED_JS in sent) == publishes_angle


def test_the_image_is_shown_in_a_frame_of_its_own():
    rig = rigs.simulated(seed=1)
    sample = rig.scanner.measure(5.0)
    sent = published(rig, Measured(role="search", index=1, sample=sample))
    (picture,) = sent[topics.PICTURE]
    assert picture.header.frame_id == "trus_image"
    # One message with each transform once: tf2 complains of a transform that comes twice with one stamp.
    (frames,) = sent[topics.FRAMES]
    assert [each.child_frame_id for each in frames.transforms] == ["trus_probe", "trus_image"]
    place = frames.transforms[1].transform.translation
    at = rig.imaging.picture(sample.frame).geometry
    expected = (0.0, at.first_lateral_m, rig.facts.face_radius_m + at.first_depth_m)
    assert (place.x, place.y, place.z) == pytest.approx(expected, abs=1e-9)
    # A subscriber puts any pixel in its place: the frame is that of the first, the sample says how far apart they are.
    (said,) = sent[topics.SAMPLE]
    image = rig.imaging.picture(sample.frame)
    geometry = json.loads(said.data)["images"]
    row, column = np.unravel_index(image.envelope.argmax(), image.envelope.shape)
    place = frames.transforms[1].transform.translation
    across_m = place.y + column * geometry["trus_image"]["lateral_spacing_m"]
    deep_m = place.z - rig.facts.face_radius_m + row * geometry["trus_image"]["depth_spacing_m"]
    assert (across_m, deep_m) == pytest.approx((image.lateral_m[column], image.depth_m[row]), abs=1e-9)


@pytest.mark.parametrize(("kind", "stamps_s"), [("bench", [0.75, 0.8]), ("simulated", [1.0, 1.0])])
def test_each_frame_of_a_sweep_has_its_own_angle_and_stamp(kind, stamps_s):
    rig = rigs.simulated(seed=1)
    sample = rig.scanner.measure(5.0)
    configuration = configuration_of(rig, SearchPlan(method="posterior", sweep_speed_deg_s=8.6))
    configuration = structs.replace(configuration, facts=structs.replace(configuration.facts, kind=kind))
    node = Node()
    shown = SampleTopics(node=node, publishes_angle=True)
    shown.begin(configuration)
    # Two pulses that come together: they were fired 0.25 and 0.2 s before.
    for index, (angle_deg, fired_s) in enumerate([(5.0, 99.75), (5.4, 99.8)], start=1):
        frame = structs.replace(sample.frame, header=structs.replace(sample.frame.header, started_s=fired_s))
        timing = SweepTiming(number=1, speed_deg_s=8.6)
        pulse = structs.replace(sample, angle_deg=angle_deg, frame=frame, sweep=timing)
        event = Measured(role="search", index=index, sample=pulse)
        shown.publish(pictured_entry(configuration, event, number=index, clock_s=100.0))
    joints = node.sent[topics.MEASURED_JS]
    assert [np.rad2deg(each.position[0]) for each in joints] == pytest.approx([5.0, 5.4])
    for topic in (topics.MEASURED_JS, topics.PICTURE, topics.ENVELOPE):
        stamps = [each.header.stamp for each in node.sent[topic]]
        assert [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps] == pytest.approx(stamps_s)
    said = [json.loads(each.data) for each in node.sent[topics.SAMPLE]]
    assert [(each["angle_deg"], each["time_s"]) for each in said] == [
        (5.0, pytest.approx(stamps_s[0])),
        (5.4, pytest.approx(stamps_s[1])),
    ]
