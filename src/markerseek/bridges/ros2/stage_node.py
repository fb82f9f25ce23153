"""The stage as a ROS 2 node: it takes angles from any client, under a guard of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from markerseek.bridges.ros2.serving import Served, StepEnded
from markerseek.core import LimitError, MarkerseekError, Stage
from markerseek.guard import Guard, State
from markerseek.ros import MOST_AGE_S, RosNode, degrees, joint_angle_deg, messages, topics
from markerseek.scan import DeadMan

_JOINT, _NUMBER, _EMPTY = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "std_msgs/msg/Empty"
_PUBLISH_S = 0.1
"""Time between two angles while the stage rests, in seconds; while it turns it has one reader, the driver."""

_REFUSAL_S = 0.05
"""Least time between two answers to commands that are refused, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainTopics:
    """Topics of plain numbers, as in the paper: off unless they are named, because a number carries no stamp.

    Attributes
    ----------
    command, reached
        Where an angle to go to is read, and where the angle reached is published: std_msgs/Float64.
    unit
        Unit of both.
    """

    command: str
    reached: str
    unit: Literal["rad", "deg"] = "rad"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    angle_deg: float
    servo: bool


class StageNode(Served):
    """Serves a stage.

    Parameters
    ----------
    node, guard, by, dead_man, simulated
        As of `Served`; the lease is held during a move.
    stage
        The stage.
    plain
        Topics of plain numbers; None for none.
    """

    def __init__(
        self,
        *,
        node: RosNode,
        stage: Stage,
        guard: Guard,
        by: str,
        plain: PlainTopics | None = None,
        dead_man: DeadMan | None = None,
        simulated: bool = False,
    ) -> None:
        super().__init__(node=node, guard=guard, by=by, dead_man=dead_man, simulated=simulated)
        self._stage, self._plain = stage, plain
        self._wanted: _Wanted | None = None
        self._moving: _Wanted | None = None
        self._renewed_s = -math.inf
        self._stopped = False
        self._refused = ("", 0)
        self._moves = self._stops = 0
        self._angle_deg = math.nan
        self._due_s = self._refusal_due_s = -math.inf
        for topic in (topics.MEASURED_JS, topics.SETPOINT_JS):
            node.advertise(topic, _JOINT)
        node.advertise(topics.OPERATING_STATE, messages.state_kind(node.kinds))
        node.subscribe(topics.MOVE_JP, _JOINT, lambda message: self._on_joint(message, servo=False))
        node.subscribe(topics.SERVO_JP, _JOINT, lambda message: self._on_joint(message, servo=True))
        node.subscribe(topics.STOP, _EMPTY, lambda _message: self.stop())
        if plain is not None:
            node.advertise(plain.reached, _NUMBER)
            node.subscribe(plain.command, _NUMBER, self._on_number)

    # What messages ask for; these run inside of a device's wait too.

    def _on_joint(self, message: Any, *, servo: bool) -> None:
        stamp_ns = messages.stamp_ns(message)
        reason = self._commands.refusal(stamp_ns, now_s=self.node.now_s())
        self._take(joint_angle_deg(message), reason, stamp_ns=stamp_ns, servo=servo)

    def _on_number(self, message: Any) -> None:
        assert self._plain is not None  # noqa: S101  its topic is subscribed to only then
        self._take(message.data if self._plain.unit == "deg" else degrees(message.data), None, stamp_ns=0, servo=False)

    def _take(self, angle_deg: float | None, reason: str | None, *, stamp_ns: int, servo: bool) -> None:
        """Note an angle that is wanted; if there is a reason against it, say so."""
        if reason is None:
            reason = self._refusal_of(angle_deg, servo=servo)
        if reason is not None:
            self._refuse(reason, stamp_ns)
        elif angle_deg is not None:
            self._wanted = _Wanted(angle_deg=angle_deg, servo=servo)
            self._renewed_s = self.node.now_s()

    def _refusal_of(self, angle_deg: float | None, *, servo: bool) -> str | None:
        """Why an angle is not gone to; None if it is."""
        if angle_deg is None:
            return self._commands.drop("no angle", f"it is no position of the joint {messages.JOINT} alone")
        if self._guard.state in (State.FAULT, State.DISARMED):
            fault = self._guard.fault
            return self._commands.drop("not armed", f"the stage node is {self._guard.state.value}: {fault or 'arm it'}")
        try:
            self._guard.limits.require_search(angle_deg)
        except LimitError as problem:
            return self._commands.drop("out of range", str(problem))
        if self._moving is not None and not (servo and self._moving.servo):
            return self._commands.drop("busy", "the stage is turning; wait until it is idle, or stop it first")
        return None

    def _refuse(self, reason: str, stamp_ns: int) -> None:
        self._refused = (reason, stamp_ns)
        now_s = self.node.now_s()
        # A flood of bad commands is not answered one by one: the state that is due next says why.
        if now_s >= self._refusal_due_s:
            self._refusal_due_s = now_s + _REFUSAL_S
            self._publish_state(is_busy=self._moving is not None)

    def stop(self) -> None:
        """End the move; what was asked for and not begun is forgotten."""
        self._wanted = None
        self._stopped = True
        self._stops += 1

    def beat(self) -> None:
        """End the move if that is wanted; called while the stage turns, after the messages have been handled.

        Raises
        ------
        Interrupted
            If somebody stops it, or a servo command was not renewed.
        """
        if self._moving is None:
            return
        if self._moving.servo and self.node.now_s() - self._renewed_s > MOST_AGE_S:
            self.stop()
        if self._stopped:
            raise StepEnded

    # What the node does between two moves.

    def step(self) -> None:
        """Carry out the last command, and publish angle, state and diagnostics when they are due."""
        now_s = self.node.now_s()
        self._stopped = False
        wanted, self._wanted = self._wanted, None
        if wanted is not None and not (wanted.servo and now_s - self._renewed_s > MOST_AGE_S):
            self._move(wanted)
        elif now_s >= self._due_s:
            self._due_s = now_s + _PUBLISH_S
            self._publish_angle()
        self._diagnose({"angle_deg": f"{self._angle_deg:.3f}", "moves": self._moves, "stops": self._stops})

    def _move(self, wanted: _Wanted) -> None:
        self._moving = wanted
        self._moves += 1
        setpoint = messages.joint_state(self.node.kinds, time_s=self.node.now_s(), angle_deg=wanted.angle_deg)
        self.node.publish(topics.SETPOINT_JS, setpoint)
        self._publish_state(is_busy=True)
        try:
            self._turn(wanted.angle_deg)
        except StepEnded:
            self._end_interrupted()
        except MarkerseekError as error:
            self._fail(error)
            self._make_safe()
        finally:
            self._moving = None
        self._publish_angle()
        if self._plain is not None:
            value = self._angle_deg if self._plain.unit == "deg" else math.radians(self._angle_deg)
            self.node.publish(self._plain.reached, messages.number(self.node.kinds, value))

    def _turn(self, angle_deg: float) -> None:
        self._guard.begin_move(angle_deg)
        with self._lease_held():
            reached_deg = self._stage.move_to(angle_deg)
        self._guard.end_move(reached_deg)

    def _make_safe(self) -> None:
        # Not interrupted a second time: the stop itself waits for the stage.
        self._moving = None
        try:
            self._stage.stop()
        except MarkerseekError as error:
            self._fail(error)

    # What it tells.

    def _publish_angle(self) -> None:
        """Publish the angle read back, and that the stage is idle, with one stamp."""
        try:
            self._angle_deg = self._guard.readback(self._stage.angle_deg)
        except MarkerseekError as error:
            self._fail(error)
            self._publish_state(is_busy=False)
            return
        now_s = self.node.now_s()
        message = messages.joint_state(self.node.kinds, time_s=now_s, angle_deg=self._angle_deg)
        self.node.publish(topics.MEASURED_JS, message)
        self._publish_state(is_busy=False, stamp_ns=messages.time_ns(now_s))

    def _publish_state(self, *, is_busy: bool, stamp_ns: int | None = None) -> None:
        states = {State.FAULT: "FAULT", State.DISARMED: "DISABLED"}
        held = messages.OperatingState(
            state=states.get(self._guard.state, "ENABLED"),
            # No verb of this node homes a stage; a stage that is not homed is not connected to.
            is_homed=True,
            is_busy=is_busy,
            stamp_ns=messages.time_ns(self.node.now_s()) if stamp_ns is None else stamp_ns,
            angle_deg=None if stamp_ns is None else self._angle_deg,
            simulated=self._simulated,
            refused=self._refused[0],
            refused_ns=self._refused[1],
        )
        self.node.publish(topics.OPERATING_STATE, messages.state(self.node.kinds, held))
