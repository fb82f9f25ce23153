"""Publishes acquisitions: angle, transforms, images, intensity."""

from __future__ import annotations

from typing import Any

from markerseek.core import BModeImage, ChannelFrame, Measured, RFFrame
from markerseek.records.journal import Configuration
from markerseek.ros import RosNode, messages, topics
from markerseek.runs import KnownRegistration, rebuild_image_reader
from markerseek.signals import AnyImageReader

_TEXT, _JOINT = "std_msgs/msg/String", "sensor_msgs/msg/JointState"


class SampleTopics:
    """The topics of the acquisitions of one rig.

    ``publishes_angle``: whether the angle of the probe is published, too, and its transform.
    """

    def __init__(self, *, node: RosNode, publishes_angle: bool) -> None:
        self._node, self._publishes_angle = node, publishes_angle
        self._face_radius_m: float | None = None
        self._imaging: AnyImageReader | None = None
        self._brightest = 0.0
        self._on_bench = False
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
            (topics.BMODE, "sensor_msgs/msg/Image"),
        ):
            node.advertise(topic, kind)

    def begin(self, configuration: Configuration) -> None:
        """Begin a run.

        ``configuration``: published as JSON, and kept for subscribers that come later.
        """
        self._imaging = rebuild_image_reader(configuration)
        self._face_radius_m, self._brightest = configuration.facts.face_radius_m, 0.0
        self._on_bench = configuration.facts.kind == "bench"
        known = configuration.flat()
        # Settings of a rig hold ports and programs of this computer, which nobody on a network needs.
        known.pop("recipe")
        message = messages.text({**known, "picture_range_db": messages.RANGE_DB})
        self._node.publish(topics.BANK, message)

    def publish(self, event: Measured, *, clock_s: float) -> None:
        """Publish one acquisition, stamped now; a pulse of a sweep on a bench with the moment of its light.

        ``event``: the acquisition; an image is made of its frame where it has one. ``clock_s``: time of the event on
        the rig's clock.
        """
        sample = event.sample
        angle_deg, intensity, frame = sample.angle_deg, sample.reading.intensity, sample.frame
        node, time_s = self._node, self._node.now_s()
        if self._on_bench and sample.sweep is not None and frame is not None:
            # Pulses of a sweep come in bundles, and the probe turns meanwhile.
            time_s -= max(0.0, clock_s - frame.header.started_s)
        image = None
        b_mode: BModeImage | None = frame if isinstance(frame, BModeImage) else getattr(frame, "b_mode", None)
        if isinstance(frame, ChannelFrame | RFFrame) and self._imaging is not None:
            image = self._imaging.picture(frame)
        if self._publishes_angle:
            node.publish(topics.MEASURED_JS, messages.joint_state(time_s=time_s, angle_deg=angle_deg))
        shown = {messages.IMAGE: image, messages.BMODE: b_mode}
        images = {name: each.geometry for name, each in shown.items() if each is not None}
        turned = messages.transforms(
            time_s=time_s,
            angle_deg=angle_deg,
            images=images,
            face_radius_m=self._face_radius_m,
        )
        # A stage node publishes itself how the probe is turned: then only the places of the images are left.
        publish_frames(node, topics.FRAMES, turned if self._publishes_angle else turned[1:])
        if b_mode is not None:
            node.publish(topics.BMODE, messages.b_mode(b_mode, time_s=time_s))
        if image is not None:
            self._brightest = max(self._brightest, float(image.envelope.max()))
            node.publish(topics.ENVELOPE, messages.envelope(image, time_s=time_s))
            # White is the brightest so far: what will come is not known.
            picture = messages.picture(image, time_s=time_s, brightest=self._brightest)
            node.publish(topics.PICTURE, picture)
        said = {
            "index": event.index,
            "role": event.role,
            "angle_deg": angle_deg,
            "intensity": intensity,
            "time_s": time_s,
            "pulses": None if frame is None else frame.header.pulses,
            # sensor_msgs/Image has no place for it, and a transform none for the distances.
            "images": {name: geometry.grid for name, geometry in images.items()},
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


def publish_registration(node: RosNode, registration: KnownRegistration) -> None:
    """Publish a registration, kept for subscribers that come later."""
    message = messages.registered(registration.davinci_to_trus, time_s=node.now_s(), simulated=registration.simulated)
    node.advertise(topics.REGISTRATION, "geometry_msgs/msg/TransformStamped", latched=True)
    node.advertise(topics.STATIC_FRAMES, messages.frames_kind(), latched=True)
    node.publish(topics.REGISTRATION, message)
    publish_frames(node, topics.STATIC_FRAMES, [message])
