"""Publishes a registration: that of a file once, that of a session as long as it holds.

What tf2 has received as static it keeps for ever, so that only the transform of a finished file is static. That of a
session goes to ``/tf`` with the time of day, again and again: a lookup at the time of an image fails once it is
withdrawn. Subscribers to the latched topics get a transform of NaN then, and a state that is not decided.
"""

from __future__ import annotations

import time

from markerseek.bridges.followed import RegistrationSource
from markerseek.bridges.ros2.sample_topics import publish_frames
from markerseek.registration import KnownRegistration
from markerseek.ros import RosNode, messages, topics

FRAME_S = 0.1
"""Time from one transform of a session to the next on ``/tf``, in seconds."""


class RegistrationTopics:
    """The topics of a registration; the node must have advertised ``/tf``."""

    def __init__(self, *, node: RosNode, source: RegistrationSource) -> None:
        self._node, self._source = node, source
        node.advertise(topics.REGISTRATION, "geometry_msgs/msg/TransformStamped", latched=True)
        node.advertise(topics.REGISTRATION_STATE, "std_msgs/msg/String", latched=True)
        self._state = source.state
        self._known = self._state.registration
        self._next_s = 0.0
        if self._state.session is None and self._known is not None:
            node.advertise(topics.STATIC_FRAMES, messages.frames_kind(), latched=True)
            publish_frames(node, topics.STATIC_FRAMES, [self._message(self._known)])
        if self._known is not None:
            node.publish(topics.REGISTRATION, self._message(self._known))
        node.publish(topics.REGISTRATION_STATE, messages.text(self._state.known))

    def step(self) -> str | None:
        """Publish what is due; returns a sentence where the state has changed."""
        state, said = self._source.state, None
        if state is not self._state:
            self._state, said = state, state.sentence
            if state.registration is not self._known:
                self._known, self._next_s = state.registration, 0.0
                self._node.publish(topics.REGISTRATION, self._message(self._known))
            self._node.publish(topics.REGISTRATION_STATE, messages.text(state.known))
        if state.session is not None and self._known is not None and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + FRAME_S
            publish_frames(self._node, topics.FRAMES, [self._message(self._known)])
        return said

    def _message(self, known: KnownRegistration | None) -> object:
        transform = None if known is None else known.davinci_to_trus
        return messages.registered(transform, time_s=self._node.now_s(), simulated=self._state.simulated)
