"""Driver of an acquisition node of ROS 2, which is laser and receiver."""

from __future__ import annotations

import math
import secrets
from functools import partial
from typing import Annotated, Any

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    DeviceTimeoutError,
    Frame,
    FrameHeader,
    Int16,
    LaserError,
    NotConnectedError,
    Permit,
    Within,
    is_finite,
)
from markerseek.drivers._ros2_waiting import STATE_S, require_found, wait_until
from markerseek.drivers.entry import Entry, LaserKeys, Opening, ReceiverKeys
from markerseek.drivers.standard_laser import LaserPermits
from markerseek.ros import RosNode, messages, topics


class Ros2LaserSettings(LaserKeys, frozen=True, kw_only=True, tag="ros2"):
    """The laser of an acquisition node, which fires it under its own guard; the receiver's driver must be the same."""


class Ros2ReceiverSettings(ReceiverKeys, frozen=True, kw_only=True, tag="ros2"):
    """The receiver of an acquisition node."""

    request_topic: str = topics.ACQUIRE
    answer_topic: str = topics.ACQUIRED
    frame_topic: str = topics.CHANNELS
    """``request_topic``, ``answer_topic`` and ``frame_topic``: where an acquisition is asked for, where it is answered,
    and where its channel data come."""
    connect_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 10.0
    """Longest time until the node is found."""
    timeout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 60.0
    """Longest time from the request to the frame."""


class Ros2Acquisition:
    """Laser and receiver of an acquisition node: one class for both, because one request fires and records.

    ``settings``: its keys in the rig file. ``emulated``: whether the node says that it is simulated. Raises
    `NotConnectedError` if there is no such node.
    """

    def __init__(self, *, node: RosNode, clock: Clock, settings: Ros2ReceiverSettings) -> None:
        self._node = node
        self._clock = clock
        self._settings = settings
        self._wait_until = partial(wait_until, node, clock)
        # Two searches use the same tokens; an answer to an earlier search must not be taken for an answer to this one.
        self._session = secrets.token_hex(4)
        self._permits = LaserPermits("laser", clock)
        self._armed: Permit | None = None
        self._fired: tuple[Permit, float] | None = None
        self._answers: dict[str, messages.Acquired] = {}
        self._frames: dict[int, Int16[np.ndarray, "channels samples"]] = {}
        self.emulated = False
        self._states = 0
        node.advertise(settings.request_topic, "std_msgs/msg/String")
        state_topic = topics.beside(settings.answer_topic, topics.ACQUISITION_STATE)
        node.subscribe(state_topic, "std_msgs/msg/String", self._on_state, latched=True)
        node.subscribe(settings.answer_topic, "std_msgs/msg/String", self._on_answer)
        node.subscribe(settings.frame_topic, "sensor_msgs/msg/Image", self._on_frame)

        def found() -> bool:
            return node.matched(settings.request_topic) and all(
                node.publishes(topic) for topic in (settings.answer_topic, settings.frame_topic)
            )

        require_found(
            node,
            clock,
            found,
            missing=f"receiver: no acquisition node on {settings.request_topic}",
            cure="start the acquisition node, and compare topics",
            connect_s=settings.connect_s,
        )

        # A node of another program need not say whether it is simulated.
        says = node.publishes(state_topic)
        self._wait_until(lambda: self._states > 0, timeout_s=settings.connect_s if says else STATE_S)

    def _on_state(self, message: Any) -> None:
        state = messages.decoded(message.data, messages.AcquisitionState)
        self._states += 1
        self.emulated = self.emulated or (state is not None and state.simulated)

    def _on_answer(self, message: Any) -> None:
        answer = messages.decoded(message.data, messages.Acquired)
        if answer is not None and answer.id.startswith(f"{self._session}."):
            self._answers[f"{answer.id} {answer.step}"] = answer

    def _on_frame(self, message: Any) -> None:
        counts = messages.channel_data_of(message)
        if counts is not None:
            # Only the newest two are kept: frames of half a megabyte that nobody asked for must not pile up.
            self._frames = {**dict(list(self._frames.items())[-1:]), messages.stamp_ns(message): counts}

    def _id(self, permit: Permit) -> str:
        return f"{self._session}.{permit.token}"

    def fire(self, permit: Permit) -> int:
        """Ask the node to fire and record, and return how many pulses were fired.

        Raises `LaserError` if the permit was used before or has expired, or the node refuses. Raises
        `DeviceTimeoutError` if the node does not answer.
        """
        self._permits.use(permit, needed_s=0.0)
        self._frames.clear()
        self._answers.clear()
        began_s = self._clock.now_s()
        request = messages.AcquireRequest(
            id=self._id(permit),
            pulses=permit.pulses,
            angle_rad=math.radians(permit.angle_deg),
            stamp_ns=messages.time_ns(self._node.now_s()),
        )
        self._node.publish(self._settings.request_topic, messages.text(request))
        answer = self._answered(permit, "fired", what="laser")
        if answer.error:
            raise LaserError(f"laser: the acquisition node refuses: {answer.error}")
        if answer.simulated and not self.emulated:
            # It said so too late: no result may name a simulated laser as a real one.
            raise NotConnectedError("laser: the acquisition node is simulated, which it did not say in time; try again")
        self._fired = (permit, began_s)
        return answer.pulses

    def _answered(self, permit: Permit, step: str, *, what: str) -> messages.Acquired:
        keys = f"{self._id(permit)} {step}", f"{self._id(permit)} error"
        found = self._wait_until(
            lambda: any(key in self._answers for key in keys),
            timeout_s=self._settings.timeout_s,
            of=self._settings.answer_topic,
        )
        if not found:
            raise DeviceTimeoutError(
                f"{what}: the acquisition node does not answer within {self._settings.timeout_s:g} s; look at it, and "
                "at receiver.timeout_s"
            )
        return self._answers.get(keys[0]) or self._answers[keys[1]]

    def disarm(self) -> None:
        """Ask the node to end what it does; allowed at any time, also twice."""
        self._armed = None
        self._fired = None
        cancel = messages.AcquireRequest(id=f"{self._session}.cancel", pulses=-1, angle_rad=0.0, stamp_ns=0)
        self._node.publish(self._settings.request_topic, messages.text(cancel))

    def settle(self) -> None:
        """Nothing to wait for: a frame names the request that it answers."""

    def arm(self, permit: Permit) -> None:
        """Note which permit will be fired; the node arms its receiver when it is asked to fire."""
        self._armed = permit
        self._fired = None

    def acquire(self, permit: Permit) -> Frame:
        """Return the frame of the request of this permit.

        Raises `AcquisitionError` if it was not armed or fired under this permit, or the node reports an error. Raises
        `DeviceTimeoutError` if no frame comes in time.
        """
        if self._armed != permit or self._fired is None or self._fired[0] != permit:
            raise AcquisitionError(f"receiver: it was not armed and fired under the permit {permit.token!r}")
        began_s = self._fired[1]
        self._armed = None
        self._fired = None
        answer = self._answered(permit, "frame", what="receiver")
        if answer.error:
            raise AcquisitionError(f"receiver: the acquisition node reports: {answer.error}")
        came = self._wait_until(
            lambda: answer.stamp_ns in self._frames,
            timeout_s=self._settings.timeout_s,
            of=self._settings.frame_topic,
        )
        if not came:
            raise DeviceTimeoutError(
                f"receiver: the channel data of its answer did not come on {self._settings.frame_topic} within "
                f"{self._settings.timeout_s:g} s"
            )
        if not is_finite(answer.sampling_hz) or answer.sampling_hz != self._settings.sampling_hz:
            raise AcquisitionError(
                f"receiver: the node samples at {answer.sampling_hz} Hz, the rig file says "
                f"{self._settings.sampling_hz:g} Hz; correct one of them"
            )
        header = FrameHeader(
            sequence=answer.sequence,
            token=permit.token,
            pulses=answer.pulses,
            commanded_deg=permit.commanded_deg,
            started_s=began_s,
            ended_s=self._clock.now_s(),
            energy=answer.energy if permit.pulses else None,
        )
        samples = self._frames.pop(answer.stamp_ns)
        return ChannelFrame(header=header, samples=samples, sampling_hz=self._settings.sampling_hz)


def _open_receiver(settings: Ros2ReceiverSettings, opening: Opening) -> Ros2Acquisition:
    return Ros2Acquisition(node=opening.node(), clock=opening.clock, settings=settings)


def _open_laser(_settings: Ros2LaserSettings, opening: Opening) -> Ros2Acquisition:
    # One node: it is the receiver, which was opened before.
    node = opening.receiver
    assert isinstance(node, Ros2Acquisition)  # noqa: S101  `BenchSettings` has checked that they go together
    return node


RECEIVER_ENTRY: Entry[Ros2ReceiverSettings, Ros2Acquisition] = Entry(
    settings=Ros2ReceiverSettings,
    open=_open_receiver,
    describe=lambda settings, node: (
        f"{'SIMULATED ' if node.emulated else ''}acquisition node on {settings.request_topic}"
    ),
    paired=True,
    is_node=True,
)
LASER_ENTRY: Entry[Ros2LaserSettings, Ros2Acquisition] = Entry(
    settings=Ros2LaserSettings, open=_open_laser, describe=lambda _settings, _node: "", paired=True, is_node=True
)
