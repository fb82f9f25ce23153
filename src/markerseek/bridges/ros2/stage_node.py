"""The stage as a ROS 2 node: it takes angles from any client, under a guard of its own."""

from __future__ import annotations

import math
import time
from typing import Any, Protocol, runtime_checkable

from markerseek.bridges.ros2.sample_topics import publish_frames
from markerseek.bridges.ros2.serving import Served, Serving, StepEnded
from markerseek.core import LimitError, MarkerseekError, Stage, plain
from markerseek.guard import State
from markerseek.ros import joint_angle_deg, messages, topics

_JOINT = "sensor_msgs/msg/JointState"
_EMPTY = "std_msgs/msg/Empty"
_PUBLISH_S = 0.1
"""Time between two angles while the stage rests, in seconds."""

_TURNING_S = 0.02
"""Time between two angles while it turns, in seconds."""


@runtime_checkable
class _SeenOnItsWay(Protocol):
    """A stage that reports where it is while it turns, from what its driver reads anyway: it has one reader."""

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading, in degrees."""


class StageNode(Served):
    """Serves a stage; the lease is held during a move."""

    def __init__(self, serving: Serving, *, stage: Stage) -> None:
        super().__init__(serving)
        node = self.node
        self._stage = stage
        self._wanted_deg: float | None = None
        self._moving = False
        self._stopped = False
        self._refused = ("", 0)
        self._angle_deg = math.nan
        self._setpoint_deg = math.nan
        self._due_s = -math.inf
        node.advertise(topics.MEASURED_JS, _JOINT)
        node.advertise(topics.SETPOINT_JS, _JOINT, latched=True)
        node.advertise(topics.FRAMES, messages.frames_kind())
        node.advertise(topics.STATE, "std_msgs/msg/String")
        node.subscribe(topics.MOVE_JP, _JOINT, self._on_joint, command=True)
        for topic in (topics.STOP, topics.HOLD):
            node.subscribe(topic, _EMPTY, lambda _message: self.stop(), command=True)

    # What messages ask for; these run inside of a device's wait too.

    def _on_joint(self, message: Any) -> None:
        stamp_ns = messages.stamp_ns(message)
        reason = self._commands.refusal(stamp_ns, now_s=self.node.now_s())
        alone = len(message.position) == 1
        self._take(joint_angle_deg(message) if alone else None, reason, stamp_ns=stamp_ns)

    def _take(self, angle_deg: float | None, reason: str | None, *, stamp_ns: int) -> None:
        """Note an angle that is wanted; if there is a reason against it, publish the reason."""
        reason = reason or self._refusal_of(angle_deg)
        if reason is None:
            self._wanted_deg = angle_deg
            return
        self._refused = (reason, stamp_ns)
        self._publish_state(is_busy=self._moving)

    def _refusal_of(self, angle_deg: float | None) -> str | None:
        """Return why the stage is not sent to an angle; None if it is."""
        if angle_deg is None:
            return f"it is no position of the joint {messages.JOINT} alone"
        if self._guard.state in (State.FAULT, State.DISARMED):
            fault = self._guard.fault
            return f"the stage node is {self._guard.state.value}: {fault or 'arm it'}"
        try:
            self._guard.limits.require_search(angle_deg)
        except LimitError as problem:
            return plain(str(problem))
        if (other := self.node.other(topics.STATE)) is not None:
            return f"{other}: both would turn; end one of them"
        if self._moving:
            return "the stage is turning; wait until it is idle, or stop it first"
        return None

    def stop(self) -> None:
        """End the move; a command that was accepted and not begun is forgotten."""
        self._wanted_deg = None
        self._stopped = True

    def beat(self) -> None:
        """Publish the angle, and end the move if somebody stops it, by `StepEnded`; called while the stage turns."""
        if not self._moving:
            return
        if time.monotonic() >= self._due_s and isinstance(self._stage, _SeenOnItsWay):
            self._due_s = time.monotonic() + _TURNING_S
            if math.isfinite(seen_deg := self._stage.seen_deg):
                self._publish_seen(seen_deg, time_s=self.node.now_s())
        if self._stopped:
            raise StepEnded

    # What the node does between two moves.

    def step(self) -> None:
        """Carry out the last command, and publish angle and state when they are due."""
        self._stopped = False
        wanted_deg = self._wanted_deg
        self._wanted_deg = None
        if wanted_deg is not None:
            self._move(wanted_deg)
        elif time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _PUBLISH_S
            self._publish_angle()

    def _move(self, angle_deg: float) -> None:
        self._moving = True
        self._due_s = -math.inf
        self._publish_setpoint(angle_deg)
        self._publish_state(is_busy=True)
        try:
            self._guard.begin_move(angle_deg)
            with self._lease_held():
                reached_deg = self._stage.move_to(angle_deg)
            self._guard.end_move(reached_deg)
        except StepEnded:
            # Its setpoint is where it stands, whatever it was sent to.
            self._setpoint_deg = math.nan
            self._end_interrupted()
        except MarkerseekError as error:
            self._fail(error)
            self._make_safe()
        finally:
            self._moving = False
        self._publish_angle()

    def _make_safe(self) -> None:
        # Not interrupted a second time: the stop itself waits for the stage.
        self._moving = False
        try:
            self._stage.stop()
        except MarkerseekError as error:
            self._fail(error)

    # What it publishes.

    def _publish_angle(self) -> None:
        """Publish the angle read back, and that the stage is idle, with one stamp."""
        try:
            self._angle_deg = self._guard.readback(self._stage.angle_deg)
        except MarkerseekError as error:
            self._fail(error)
            self._publish_state(is_busy=False)
            return
        now_s = self.node.now_s()
        self._publish_setpoint(self._angle_deg if math.isnan(self._setpoint_deg) else self._setpoint_deg)
        self._publish_seen(self._angle_deg, time_s=now_s)
        self._publish_state(is_busy=False, stamp_ns=messages.time_ns(now_s))

    def _publish_seen(self, angle_deg: float, *, time_s: float) -> None:
        node = self.node
        node.publish(topics.MEASURED_JS, messages.joint_state(time_s=time_s, angle_deg=angle_deg))
        publish_frames(node, topics.FRAMES, [messages.turned_probe(time_s=time_s, angle_deg=angle_deg)])

    def _publish_setpoint(self, angle_deg: float) -> None:
        self._setpoint_deg = angle_deg
        message = messages.joint_state(time_s=self.node.now_s(), angle_deg=angle_deg)
        self.node.publish(topics.SETPOINT_JS, message)

    def _publish_state(self, *, is_busy: bool, stamp_ns: int | None = None) -> None:
        states = {State.FAULT: "FAULT", State.DISARMED: "DISABLED"}
        held = messages.OperatingState(
            state=states.get(self._guard.state, "ENABLED"),
            # This node homes no stage; a stage that is not homed is not connected to.
            is_homed=True,
            is_busy=is_busy,
            stamp_ns=messages.time_ns(self.node.now_s()) if stamp_ns is None else stamp_ns,
            angle_deg=None if stamp_ns is None else self._angle_deg,
            simulated=self._simulated,
            refused=self._refused[0],
            refused_ns=self._refused[1],
            fault=self._guard.fault or "",
        )
        self.node.publish(topics.STATE, messages.text(held))
