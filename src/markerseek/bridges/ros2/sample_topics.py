"""Publishes acquisitions (angle, transforms, images, intensity), and a registration.

The registration of a file is published once, that of a session as long as it holds. What tf2 has received as static it
keeps for ever, so that only the transform of a finished file is static. That of a session goes to ``/tf`` with the time
of day, again and again: a lookup at the time of an image fails once it is withdrawn. Subscribers to the latched topics
get a transform of NaN then, and a state that is not decided.
"""

from __future__ import annotations

import time
from typing import Any

from msgspec import structs

from markerseek.bridges.followed import RegistrationSource
from markerseek.bridges.run_images import PicturedEntry, since_fired_s
from markerseek.core import Measured
from markerseek.records.journal import Configuration, RunView
from markerseek.registration import KnownRegistration
from markerseek.ros import RosNode, messages, topics
from markerseek.show import RANGE_DB, event_line, grey_levels

_TEXT = "std_msgs/msg/String"
_JOINT = "sensor_msgs/msg/JointState"


class SampleTopics:
    """The topics of the acquisitions of one rig.

    ``publishes_angle``: whether the angle of the probe is published, too, and its transform.
    """

    def __init__(self, *, node: RosNode, publishes_angle: bool) -> None:
        self._node = node
        self._publishes_angle = publishes_angle
        self._view: RunView | None = None
        # All at once, and early: who subscribes misses what comes before the publisher is found.
        node.advertise(topics.BANK, _TEXT, latched=True)
        if publishes_angle:
            node.advertise(topics.MEASURED_JS, _JOINT)
        for topic, kind in (
            (topics.SAMPLE, _TEXT),
            (topics.FRAMES, messages.frames_kind()),
            (topics.INTENSITY, "std_msgs/msg/Float64"),
            (topics.ENVELOPE, "sensor_msgs/msg/Image"),
            (topics.PICTURE, "sensor_msgs/msg/Image"),
        ):
            node.advertise(topic, kind)

    def begin(self, configuration: Configuration) -> None:
        """Begin a run.

        ``configuration``: published as JSON, and kept for subscribers that come later.
        """
        self._view = RunView.of(configuration)
        known = structs.asdict(configuration)
        # Settings of a rig hold ports and programs of this computer, which nobody on a network needs.
        del known["recipe"]
        message = messages.text({**known, "picture_range_db": RANGE_DB})
        self._node.publish(topics.BANK, message)

    def publish(self, item: PicturedEntry) -> None:
        """Publish an acquisition, stamped with the moment of its light on a rig of devices, else with the time of day.

        ``item``: an entry of the run; one without an acquisition publishes nothing.
        """
        assert self._view is not None  # noqa: S101  the configuration comes first
        entry = item.entry
        image = item.image
        view = self._view.add_entry(entry)
        self._view = view
        if not isinstance(entry.event, Measured):
            return
        sample = entry.event.sample
        node = self._node
        angle_deg = sample.angle_deg
        intensity = sample.reading.intensity
        time_s = node.now_s() - since_fired_s(view, entry)
        if self._publishes_angle:
            node.publish(topics.MEASURED_JS, messages.joint_state(time_s=time_s, angle_deg=angle_deg))
        # A stage node publishes itself how the probe is turned: then only the place of the image is left.
        frames = [messages.turned_probe(time_s=time_s, angle_deg=angle_deg)] if self._publishes_angle else []
        if image is not None and (radius_m := view.facts.face_radius_m) is not None:
            frames.append(messages.mounted(image.geometry, time_s=time_s, face_radius_m=radius_m))
        publish_frames(node, topics.FRAMES, frames)
        if image is not None:
            node.publish(topics.ENVELOPE, messages.envelope_image(image, time_s=time_s))
            levels = grey_levels(image.envelope, brightest=item.brightest)
            node.publish(topics.PICTURE, messages.picture(levels, time_s=time_s))
        said = {
            "index": view.index,
            "role": view.role,
            "angle_deg": angle_deg,
            "intensity": intensity,
            "line": event_line(view),
            "time_s": time_s,
            "pulses": None if sample.frame is None else sample.frame.header.pulses,
            # sensor_msgs/Image has no place for the distances of pixels, and neither has a transform.
            "images": {} if image is None else {messages.IMAGE: image.geometry.grid},
        }
        node.publish(topics.SAMPLE, messages.text(said))
        if not sample.dark:  # a dark frame has no intensity to be plotted
            node.publish(topics.INTENSITY, messages.number(intensity))


def publish_frames(node: RosNode, topic: str, transforms: list[Any]) -> None:
    """Publish transforms on ``/tf`` or ``/tf_static``, in one message where tf2_msgs is installed."""
    kind = messages.frames_kind()
    together = kind == messages.FRAMES_KIND and bool(transforms)
    for message in [messages.made(kind, transforms=transforms)] if together else transforms:
        node.publish(topic, message)


FRAME_S = 0.1
"""Time from one transform of a session to the next on ``/tf``, in seconds."""


class RegistrationTopics:
    """The topics of a registration; the node must have advertised ``/tf``."""

    def __init__(self, *, node: RosNode, source: RegistrationSource) -> None:
        self._node = node
        self._source = source
        node.advertise(topics.REGISTRATION, "geometry_msgs/msg/TransformStamped", latched=True)
        node.advertise(topics.REGISTRATION_STATE, "std_msgs/msg/String", latched=True)
        self._view = source.view
        self._known = self._view.registration
        self._next_s = 0.0
        if self._view.phase is None and self._known is not None:
            node.advertise(topics.STATIC_FRAMES, messages.frames_kind(), latched=True)
            publish_frames(node, topics.STATIC_FRAMES, [self._message(self._known)])
        if self._known is not None:
            node.publish(topics.REGISTRATION, self._message(self._known))
        node.publish(topics.REGISTRATION_STATE, messages.text(self._view.known))

    def step(self) -> str | None:
        """Publish what is due; returns a sentence where the state has changed."""
        view = self._source.view
        said = None
        if view is not self._view:
            self._view = view
            said = view.sentence
            if view.registration is not self._known:
                self._known = view.registration
                self._next_s = 0.0
                self._node.publish(topics.REGISTRATION, self._message(self._known))
            self._node.publish(topics.REGISTRATION_STATE, messages.text(view.known))
        if view.phase is not None and self._known is not None and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + FRAME_S
            publish_frames(self._node, topics.FRAMES, [self._message(self._known)])
        return said

    def _message(self, known: KnownRegistration | None) -> object:
        transform = None if known is None else known.davinci_to_trus
        return messages.registered(transform, time_s=self._node.now_s(), simulated=self._view.simulated)
