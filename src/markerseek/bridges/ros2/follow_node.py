"""A run that follows, as ROS 2 programs see it: the transform of the camera on ``/tf``, its validity, and the state.

While the registration holds, ``trus_home`` to the camera is sent again and again with the time of day, carried along
with the endoscope. It is sent no more once it does not hold, or the run is silent: a lookup at the time of an image
fails then. Subscribers to the latched topics get a transform of NaN, and a state that is not decided.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from markerseek._closing import Closing
from markerseek.bridges.follow_feed import SENT_S, FollowFeed, follow_state
from markerseek.bridges.ros2.sample_topics import publish_frames
from markerseek.following import FollowStep
from markerseek.geometry import RigidTransform
from markerseek.registration import davinci_to_probe_home
from markerseek.ros import RosNode, messages, topics

_TEXT = "std_msgs/msg/String"


class FollowNode(Closing):
    """Publishes the steps of a run in a thread of its own, while it is open; the thread spins the node.

    ``simulated``: whether the registration is. ``publishes_angle``: whether the angle of the probe is published, too; a
    rig of ROS 2 nodes has a stage node that publishes it. ``on_stop``: called in that thread with who asks for a stop.
    """

    def __init__(
        self, node: RosNode, *, simulated: bool, publishes_angle: bool, on_stop: Callable[[str], None]
    ) -> None:
        self._node = node
        self._feed = FollowFeed(simulated=simulated)
        self._publishes_angle = publishes_angle
        self._sent: tuple[object, ...] = ()
        node.advertise(topics.FRAMES, messages.frames_kind())
        node.advertise(topics.REGISTRATION, "geometry_msgs/msg/TransformStamped", latched=True)
        node.advertise(topics.REGISTRATION_STATE, _TEXT, latched=True)
        node.advertise(topics.FOLLOW_STATE, _TEXT, latched=True)
        if publishes_angle:
            node.advertise(topics.MEASURED_JS, "sensor_msgs/msg/JointState")
        stopper = f"a message on {topics.FOLLOW_STOP}"
        node.subscribe(topics.FOLLOW_STOP, "std_msgs/msg/Empty", lambda _message: on_stop(stopper), command=True)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="follow-ros2", daemon=True)
        self._thread.start()

    def show(self, step: FollowStep) -> None:
        """Take a step of the run."""
        self._feed.show(step)

    def close(self) -> None:
        """Withdraw the transform, and publish no more; allowed twice."""
        if self._thread.is_alive():
            self._closing.set()
            self._thread.join()

    def _serve(self) -> None:
        due_s = time.monotonic()
        while not self._closing.is_set():
            self._publish(self._feed.step)
            # What took long does not delay those that follow; what was missed is not made up for.
            due_s = max(due_s + SENT_S, time.monotonic())
            while (left_s := due_s - time.monotonic()) > 0 and not self._closing.is_set():
                self._node.spin(left_s)
        self._publish(None)

    def _publish(self, step: FollowStep | None) -> None:
        """Publish a step; None: the run is silent."""
        node = self._node
        now_s = node.now_s()
        rows = None if step is None else step.davinci_to_trus
        camera = self._camera(None if rows is None else davinci_to_probe_home(rows), time_s=now_s)
        frames = [] if rows is None else [camera]
        if step is not None and self._publishes_angle and np.isfinite(step.probe_deg):
            frames.append(messages.turned_probe(time_s=now_s, angle_deg=step.probe_deg))
            node.publish(topics.MEASURED_JS, messages.joint_state(time_s=now_s, angle_deg=step.probe_deg))
        publish_frames(node, topics.FRAMES, frames)
        state = follow_state(step, simulated=self._feed.simulated)
        node.publish(topics.FOLLOW_STATE, messages.text(state))
        # The latched topics only where something has changed, as of a session.
        now = (rows, state["word"])
        if now != self._sent:
            self._sent = now
            node.publish(topics.REGISTRATION, camera)
            node.publish(topics.REGISTRATION_STATE, messages.text(self._registration_state(state)))

    def _camera(self, transform: RigidTransform | None, *, time_s: float) -> Any:
        return messages.registered(transform, time_s=time_s, simulated=self._feed.simulated)

    def _registration_state(self, state: dict[str, object]) -> dict[str, object]:
        """Return whether the registration holds, in the words that a session has for it."""
        errors = {"tre_m": state["tre_m"]} if state["holds"] else {}
        return {
            "simulated": state["simulated"],
            "decided": state["holds"],
            "session": "following",
            "said": state["said"],
            **errors,
        }
