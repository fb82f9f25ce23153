"""What a search shows on ROS 2 of an acquisition, with the classes of messages of rosbags and without a network."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs the extra records")
from rosbags.typesys import Stores, get_typestore

from markerseek import rigs
from markerseek.bridges.ros2.sample_topics import SampleTopics
from markerseek.core import Measured, SearchPlan
from markerseek.records.stream import StreamHead
from markerseek.ros import topics
from markerseek.runs import configuration_of
from markerseek.sim import ReceiverSettings, SimulatedSettings


class Node:
    """Keeps what is published."""

    kinds = get_typestore(Stores.ROS2_JAZZY).types

    def __init__(self):
        self.sent = {}

    def now_s(self):
        return 1.0

    def advertise(self, topic, kind, **how):
        pass

    def publish(self, topic, message):
        self.sent.setdefault(topic, []).append(message)


def test_b_mode_beside_channel_data_is_shown_in_a_frame_of_its_own():
    rig = rigs.simulated(seed=1, settings=SimulatedSettings(receiver=ReceiverSettings(b_mode=True)))
    sample = rig.scanner.measure(5.0)
    node = Node()
    shown = SampleTopics(node=node, publishes_angle=False)
    shown.begin(StreamHead(configuration=configuration_of(rig, SearchPlan(method="ternary")), frames=True))
    shown.publish(Measured(role="search", index=1, sample=sample))
    (image,), (picture,) = node.sent[topics.BMODE], node.sent[topics.PICTURE]
    assert (image.header.frame_id, picture.header.frame_id) == ("trus_bmode", "trus_image")
    b_mode = sample.frame.b_mode
    np.testing.assert_array_equal(image.data.reshape(image.height, image.width), b_mode.pixels)
    # One message with each transform once: tf2 complains of a transform that comes twice with one stamp.
    (frames,) = node.sent[topics.FRAMES]
    assert [each.child_frame_id for each in frames.transforms] == ["trus_probe", "trus_image", "trus_bmode"]
    for each, geometry in zip(
        frames.transforms[1:], (rig.imaging.picture(sample.frame).geometry, b_mode.geometry), strict=True
    ):
        place = each.transform.translation
        expected = (0.0, geometry.first_lateral_m, rig.facts.face_radius_m + geometry.first_depth_m)
        assert (place.x, place.y, place.z) == pytest.approx(expected, abs=1e-9)
    # A subscriber puts any pixel in its place: the frame is that of the first, the sample says how far apart they are.
    (said,) = node.sent[topics.SAMPLE]
    image, geometry = rig.imaging.picture(sample.frame), json.loads(said.data)["images"]
    row, column = np.unravel_index(image.envelope.argmax(), image.envelope.shape)
    place = frames.transforms[1].transform.translation
    across_m = place.y + column * geometry["trus_image"]["lateral_spacing_m"]
    deep_m = place.z - rig.facts.face_radius_m + row * geometry["trus_image"]["depth_spacing_m"]
    assert (across_m, deep_m) == pytest.approx((image.lateral_m[column], image.depth_m[row]), abs=1e-9)
    assert geometry["trus_bmode"]["depth_spacing_m"] == b_mode.geometry.depth_step_m
