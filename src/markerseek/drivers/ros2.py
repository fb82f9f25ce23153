"""Drivers of devices behind ROS 2 topics: a stage node, and an acquisition node with laser and receiver."""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable
from typing import Any

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    DeviceTimeoutError,
    Frame,
    FrameHeader,
    Int16,
    Interval,
    LaserError,
    LimitError,
    MoveError,
    NotConnectedError,
    Permit,
    is_finite,
)
from markerseek.drivers._ros2_settings import RosReceiver, RosStage
from markerseek.ros import RosNode, degrees, joint_angle_deg, messages, topics

_SLICE_S = 0.02
"""Longest time between two beats of the clock while a message is awaited, in seconds."""


class RosWait:
    """Waits for messages: spins the node, and lets the clock beat."""

    def __init__(self, node: RosNode, clock: Clock) -> None:
        self.node, self.clock = node, clock

    def until(self, arrived: Callable[[], bool], *, timeout_s: float) -> bool:
        """Whether a condition came true in time.

        Parameters
        ----------
        arrived
            The condition, which messages change.
        timeout_s
            Longest time in seconds.
        """
        ends_s = self.clock.now_s() + timeout_s
        while not arrived():
            if not self.clock.now_s() < ends_s:
                return False
            self.node.spin(_SLICE_S)
            self.clock.wait(0.0)
        return True

    def drain(self) -> None:
        """Carry out all that has arrived already, at most a few hundred messages."""
        for _ in range(200):
            before = self.node.handled
            self.node.spin(0.0)
            if self.node.handled == before:
                return


class Ros2Stage:
    """A stage node of this or another program.

    Parameters
    ----------
    node
        The node through which it is reached.
    clock
        Real time.
    settings
        Its keys in the rig file.
    travel
        Angles that it may be sent to.

    Attributes
    ----------
    simulated
        Whether its node says that it is simulated.

    Raises
    ------
    NotConnectedError
        If there is no such node, or it says no angle.
    """

    def __init__(self, *, node: RosNode, clock: Clock, settings: RosStage, travel: Interval) -> None:
        self.limits = travel
        self._node, self._clock, self._settings = node, clock, settings
        self._wait = RosWait(node, clock)
        self._angle_deg = math.nan
        self._heard_s = -math.inf
        self._reached_ns = 0
        self._readings = 0
        self._in_degrees = False
        self._states = 0
        self.simulated = False
        self._busy = self._was_busy = False
        self._idle_ns = 0
        self._refused: tuple[int, str] | None = None
        joint = settings.message == "joint_state"
        self._kind = "sensor_msgs/msg/JointState" if joint else "std_msgs/msg/Float64"
        node.advertise(settings.command_topic, self._kind)
        node.subscribe(settings.reached_topic, self._kind, self._on_joint if joint else self._on_number)
        self._stop_topic = None if settings.state_topic is None else topics.STOP
        if self._stop_topic is not None:
            node.advertise(self._stop_topic, "std_msgs/msg/Empty")
        if settings.state_topic is not None:
            node.subscribe(settings.state_topic, messages.state_kind(node.kinds), self._on_state)
        self._connect()

    def _connect(self) -> None:
        settings = self._settings
        for what, found in (
            (f"takes angles on {settings.command_topic}", lambda: self._node.matched(settings.command_topic)),
            (f"publishes an angle on {settings.reached_topic}", lambda: self._readings > 0),
            (f"publishes its state on {settings.state_topic}", lambda: not settings.state_topic or self._states > 0),
        ):
            if not self._wait.until(found, timeout_s=settings.connect_s):
                raise NotConnectedError(
                    f"stage: no node {what} within {settings.connect_s:g} s; start it, and compare topics, message "
                    "types, ROS_DOMAIN_ID and the transport"
                )

    def _on_number(self, message: Any) -> None:
        self._take(message.data if self._settings.unit == "deg" else degrees(message.data))

    def _on_joint(self, message: Any) -> None:
        if self._in_degrees:
            # The node's state has the same angle, not rounded by the way over radians.
            return
        angle_deg = joint_angle_deg(message)
        self._reached_ns = messages.stamp_ns(message)
        # What is no angle is kept as NaN, which the guard refuses.
        self._take(math.nan if angle_deg is None else angle_deg)

    def _take(self, angle_deg: float) -> None:
        self._angle_deg, self._heard_s = angle_deg, self._clock.now_s()
        self._readings += 1

    def _on_state(self, message: Any) -> None:
        state = messages.state_of(message)
        if state is None:
            return
        self._states += 1
        self.simulated = state.simulated
        self._busy = state.is_busy
        self._was_busy = self._was_busy or state.is_busy
        if not state.is_busy:
            self._idle_ns = state.stamp_ns
        if state.angle_deg is not None:
            self._in_degrees, self._reached_ns = True, state.stamp_ns
            self._take(state.angle_deg)
        self._refused = (state.refused_ns, state.refused) if state.refused else self._refused

    @property
    def angle_deg(self) -> float:
        """Angle of the last message in degrees.

        Raises
        ------
        DeviceTimeoutError
            If it is older than ``age_s``.
        """
        self._wait.drain()
        age_s = self._settings.age_s
        if age_s is not None:

            def fresh() -> bool:
                return self._clock.now_s() - self._heard_s <= age_s

            if not self._wait.until(fresh, timeout_s=age_s):
                raise DeviceTimeoutError(
                    f"stage: no angle on {self._settings.reached_topic} for more than {age_s:g} s; its node is gone "
                    "or busy"
                )
        return self._angle_deg

    def move_to(self, angle_deg: float) -> float:
        """Send it to an angle, wait until it has arrived, and return the angle read back in degrees.

        Raises
        ------
        LimitError
            If the angle is NaN or outside the travel range; nothing was sent.
        MoveError
            If the node refuses the angle.
        DeviceTimeoutError
            If it does not arrive in time.
        """
        if angle_deg not in self.limits:
            raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")
        self._wait.drain()
        self._was_busy, self._refused = False, None
        readings = self._readings
        sent_ns = self._send(angle_deg)

        def ended() -> bool:
            if self._refused is not None and self._refused[0] == sent_ns:
                return True
            if self._settings.state_topic is not None:
                # Busy, then idle: idle alone may be from before the command.
                return self._was_busy and not self._busy and self._reached_ns >= self._idle_ns
            near = abs(self._angle_deg - angle_deg) <= self._settings.arrival_deg
            return self._readings > readings and near

        if not self._wait.until(ended, timeout_s=self._settings.timeout_s):
            raise DeviceTimeoutError(
                f"stage: sent to {angle_deg:.3f} deg, it did not arrive within {self._settings.timeout_s:g} s; its "
                f"last angle is {self._angle_deg:.3f} deg; look at the stage and its node"
            )
        if self._refused is not None and self._refused[0] == sent_ns:
            raise MoveError(f"stage: its node refuses {angle_deg:.3f} deg: {self._refused[1]}")
        return self._angle_deg

    def _send(self, angle_deg: float) -> int:
        """Publish a command; returns its stamp in nanoseconds, 0 if it has none."""
        if self._settings.message == "float64":
            value = angle_deg if self._settings.unit == "deg" else math.radians(angle_deg)
            self._node.publish(self._settings.command_topic, self._kind, messages.number(self._node.kinds, value))
            return 0
        message = messages.joint_state(self._node.kinds, time_s=self._node.now_s(), angle_deg=angle_deg)
        self._node.publish(self._settings.command_topic, self._kind, message)
        return messages.stamp_ns(message)

    def stop(self) -> None:
        """Ask the node to stop, if it tells its state; a plain node ends its move by itself."""
        if self._stop_topic is not None and self._busy:
            self._node.publish(self._stop_topic, "std_msgs/msg/Empty", messages.empty(self._node.kinds))


class Ros2Acquisition:
    """Laser and receiver of an acquisition node: both protocols in one, because one request fires and records.

    Parameters
    ----------
    node, clock
        As of `Ros2Stage`.
    settings
        Its keys in the rig file.

    Raises
    ------
    NotConnectedError
        If there is no such node.
    """

    def __init__(self, *, node: RosNode, clock: Clock, settings: RosReceiver) -> None:
        self._node, self._clock, self._settings = node, clock, settings
        self._wait = RosWait(node, clock)
        # Tokens of two searches are alike; what an earlier search asked for must not answer this one.
        self._session = secrets.token_hex(4)
        self._used: set[str] = set()
        self._armed: Permit | None = None
        self._fired: tuple[Permit, float] | None = None
        self._answers: dict[str, messages.Acquired] = {}
        self._frames: dict[int, Int16[np.ndarray, "channels samples"]] = {}
        node.advertise(settings.request_topic, "std_msgs/msg/String")
        node.subscribe(settings.answer_topic, "std_msgs/msg/String", self._on_answer)
        node.subscribe(settings.frame_topic, "sensor_msgs/msg/Image", self._on_frame)

        def found() -> bool:
            return node.matched(settings.request_topic) and all(
                node.publishes(topic) for topic in (settings.answer_topic, settings.frame_topic)
            )

        if not self._wait.until(found, timeout_s=settings.connect_s):
            raise NotConnectedError(
                f"receiver: no acquisition node on {settings.request_topic} within {settings.connect_s:g} s; start "
                "markerseek ros2 acquire, and compare topics, ROS_DOMAIN_ID and the transport"
            )

    def _on_answer(self, message: Any) -> None:
        answer = messages.acquired_of(message)
        if answer is not None and answer.id.startswith(f"{self._session}."):
            self._answers[f"{answer.id} {answer.step}"] = answer

    def _on_frame(self, message: Any) -> None:
        counts = messages.counts_of(message)
        if counts is not None:
            # The newest two: a frame of half a megabyte that nobody asked for must not pile up.
            self._frames = {**dict(list(self._frames.items())[-1:]), messages.stamp_ns(message): counts}

    def _id(self, permit: Permit) -> str:
        return f"{self._session}.{permit.token}"

    def fire(self, permit: Permit) -> int:
        """Ask the node to fire and record, and return how many pulses were fired.

        Raises
        ------
        LaserError
            If the permit was used before or has expired, or the node refuses.
        DeviceTimeoutError
            If the node does not answer.
        """
        if permit.token in self._used:
            raise LaserError(f"laser: the permit {permit.token!r} was used before; nothing was fired")
        left_s = permit.expires_s - self._clock.now_s()
        if not left_s > 0:
            raise LaserError(f"laser: the permit {permit.token!r} has expired; nothing was fired")
        self._used.add(permit.token)
        self._frames.clear()
        self._answers.clear()
        began_s = self._clock.now_s()
        request = messages.AcquireRequest(
            id=self._id(permit),
            pulses=permit.pulses,
            angle_rad=math.radians(permit.angle_deg),
            stamp_ns=messages.time_ns(self._node.now_s()),
        )
        self._node.publish(
            self._settings.request_topic, "std_msgs/msg/String", messages.text(self._node.kinds, request)
        )
        answer = self._answered(permit, "fired", what="laser")
        if answer.error:
            raise LaserError(f"laser: the acquisition node refuses: {answer.error}")
        self._fired = (permit, began_s)
        return answer.pulses

    def _answered(self, permit: Permit, step: str, *, what: str) -> messages.Acquired:
        keys = f"{self._id(permit)} {step}", f"{self._id(permit)} error"
        if not self._wait.until(lambda: any(key in self._answers for key in keys), timeout_s=self._settings.timeout_s):
            raise DeviceTimeoutError(
                f"{what}: the acquisition node does not answer within {self._settings.timeout_s:g} s; look at it, and "
                "at receiver.timeout_s"
            )
        return self._answers.get(keys[0]) or self._answers[keys[1]]

    def disarm(self) -> None:
        """Ask the node to end what it does; allowed at any time, also twice."""
        self._armed = self._fired = None
        cancel = messages.AcquireRequest(id=f"{self._session}.cancel", pulses=-1, angle_rad=0.0, stamp_ns=0)
        self._node.publish(self._settings.request_topic, "std_msgs/msg/String", messages.text(self._node.kinds, cancel))

    def settle(self) -> None:
        """Nothing to wait for: a frame names the request that it answers."""

    def arm(self, permit: Permit) -> None:
        """Note which permit will be fired; the node arms its receiver when it is asked to fire."""
        self._armed, self._fired = permit, None

    def acquire(self, permit: Permit) -> Frame:
        """Frame of the request of this permit.

        Raises
        ------
        AcquisitionError
            If it was not armed or fired under this permit, or the node reports an error.
        DeviceTimeoutError
            If no frame comes in time.
        """
        if self._armed != permit or self._fired is None or self._fired[0] != permit:
            raise AcquisitionError(f"receiver: it was not armed and fired under the permit {permit.token!r}")
        began_s = self._fired[1]
        self._armed = self._fired = None
        answer = self._answered(permit, "frame", what="receiver")
        if answer.error:
            raise AcquisitionError(f"receiver: the acquisition node reports: {answer.error}")
        if not self._wait.until(lambda: answer.stamp_ns in self._frames, timeout_s=self._settings.timeout_s):
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
            commanded_deg=permit.angle_deg,
            started_s=began_s,
            ended_s=self._clock.now_s(),
        )
        return ChannelFrame(
            header=header, samples=self._frames.pop(answer.stamp_ns), sampling_hz=self._settings.sampling_hz
        )
