"""Plays a recording to the topics of a running search, with its own timing."""

from __future__ import annotations

import time
from collections.abc import Callable

from markerseek.bridges.recordings import Recording
from markerseek.bridges.ros2.sample_topics import SampleTopics
from markerseek.core import Measured, require_range
from markerseek.records.journal import Configuration, Entry
from markerseek.ros import RosNode, messages, topics

_FIND_S = 2.0
"""Time that subscribers are given to find the node before it begins, in seconds."""

_FOUND_S = 0.5
"""Time after that until who was found has found the node too, in seconds."""


def _wait_for_subscribers(node: RosNode) -> None:
    ends_s = time.monotonic() + _FIND_S
    while time.monotonic() < ends_s and not (node.matched(topics.SAMPLE) and node.matched(topics.RESULT)):
        node.spin(0.05)
    ends_s = time.monotonic() + _FOUND_S
    while time.monotonic() < ends_s:
        node.spin(0.05)


def play(recording: Recording, node: RosNode, *, pace: float, until: Callable[[], bool]) -> int:
    """Publish the acquisitions of a recording; returns their number.

    ``pace``: real seconds per recorded second; 0 does not wait. ``until``: asked between two acquisitions, and while it
    waits, whether to end.
    """
    require_range("pace", pace, low=0, high=100)
    publisher = SampleTopics(node=node, publishes_angle=True)
    node.advertise(topics.RESULT, "std_msgs/msg/String", latched=True)
    began_s, played = time.monotonic(), 0
    for after_s, item in recording.items():
        while (left_s := began_s + pace * after_s - time.monotonic()) > 0 and not until():
            node.spin(min(left_s, 0.1))
        if until():
            break
        match item:
            case Configuration():
                publisher.begin(item, played=True, recording=recording.name)
                _wait_for_subscribers(node)
                began_s = time.monotonic()
            case Entry(event=Measured() as event):
                publisher.publish(event, played=True)
                played += 1
        node.spin(0.0)
    result = messages.text(node.kinds, {"state": "played", "acquisitions": played})
    node.publish(topics.RESULT, result)
    return played
