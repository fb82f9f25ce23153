"""The stage as a ROS 2 node: it takes angles from any client, under a guard of its own."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from markerseek.bridges.ros2.sample_topics import publish_frames
from markerseek.bridges.ros2.serving import Served, StepEnded
from markerseek.core import LimitError, MarkerseekError, Stage
from markerseek.guard import Guard, State
from markerseek.ros import RosNode, degrees, joint_angle_deg, messages, topics
from markerseek.scan import Watchdog

_JOINT, _NUMBER, _EMPTY = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64", "std_msgs/msg/Empty"
_PUBLISH_S, _TURNING_S = 0.1, 0.02
"""Time between two angles while the stage rests, and while it turns, in seconds."""

_RENEW_S = 0.25
"""Longest time between two servo commands, in seconds: the stage is then told to stop within 0.3 s."""

_REFUSAL_S = 0.05
"""Least time between two answers to commands that are refused, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainTopics:
    """Topics of plain numbers, as in the paper: off unless they are named, because a number carries no stamp."""

    command: str
    reached: str
    """``command`` and ``reached``: where an angle to go to is read, and where the angle reached is published:
    std_msgs/Float64."""
    unit: Literal["rad", "deg"] = "rad"


@runtime_checkable
class _SeenOnItsWay(Protocol):
    """A stage that reports where it is while it turns, from what its driver reads anyway: it has one reader."""

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wanted:
    angle_deg: float
    servo: bool


class StageNode(Served):
    """Serves a stage.

    ``node``, ``guard``, ``by``, ``watchdog``, ``simulated``: the lease is held during a move.
    """

    def __init__(
        self,
        *,
        node: RosNode,
        stage: Stage,
        guard: Guard,
        by: str,
        plain: PlainTopics | None = None,
        watchdog: Watchdog | None = None,
        simulated: bool = False,
    ) -> None:
        super().__init__(node=node, guard=guard, by=by, watchdog=watchdog, simulated=simulated)
        self._stage, self._plain = stage, plain
        self._wanted: _Wanted | None = None
        self._moving: _Wanted | None = None
        self._renewed_s = -math.inf
        self._stopped = False
        self._refused = ("", 0)
        self._moves = self._stops = 0
        self._angle_deg = self._setpoint_deg = math.nan
        self._due_s = self._refusal_due_s = -math.inf
        node.advertise(topics.MEASURED_JS, _JOINT)
        node.advertise(topics.MEASURED_CP, "geometry_msgs/msg/PoseStamped")
        node.advertise(topics.SETPOINT_JS, _JOINT, latched=True)
        node.advertise(topics.FRAMES, messages.frames_kind(node.kinds))
        node.advertise(topics.STATE, "std_msgs/msg/String")
        node.subscribe(topics.MOVE_JP, _JOINT, lambda message: self._on_joint(message, servo=False), command=True)
        node.subscribe(topics.SERVO_JP, _JOINT, lambda message: self._on_joint(message, servo=True), command=True)
        for topic in (topics.STOP, topics.HOLD):
            node.subscribe(topic, _EMPTY, lambda _message: self.stop(), command=True)
        self._speaks_crtk = messages.CRTK_STATE in node.kinds
        if self._speaks_crtk:
            node.advertise(topics.OPERATING_STATE, messages.CRTK_STATE)
            for topic in (topics.ERROR, topics.WARNING):
                node.advertise(topic, messages.CRTK_STRING)
            node.subscribe(topics.STATE_COMMAND, messages.CRTK_STRING, self._on_state_command, command=True)
        if plain is not None:
            node.advertise(plain.reached, _NUMBER)
            node.subscribe(plain.command, _NUMBER, self._on_number, command=True)

    # What messages ask for; these run inside of a device's wait too.

    def _on_joint(self, message: Any, *, servo: bool) -> None:
        stamp_ns = messages.stamp_ns(message)
        reason = self._commands.refusal(stamp_ns, now_s=self.node.now_s())
        self._take(joint_angle_deg(message), reason, stamp_ns=stamp_ns, servo=servo)

    def _on_number(self, message: Any) -> None:
        assert self._plain is not None  # noqa: S101  its topic is subscribed to only then
        self._take(message.data if self._plain.unit == "deg" else degrees(message.data), None, stamp_ns=0, servo=False)

    def _on_state_command(self, message: Any) -> None:
        if message.string == "disable":
            self.set_active(False)
            return
        if message.string == "pause":
            self.stop()
        if message.string not in ("enable", "home") or self._guard.state in (State.FAULT, State.DISARMED):
            sentence = f"{message.string!r} is not carried out: a person arms the stage node in its own terminal"
            self._refuse(self._commands.drop("state command", sentence), messages.stamp_ns(message))

    def _take(self, angle_deg: float | None, reason: str | None, *, stamp_ns: int, servo: bool) -> None:
        """Note an angle that is wanted; if there is a reason against it, say so."""
        if reason is None:
            reason = self._refusal_of(angle_deg, servo=servo)
        if reason is not None:
            self._refuse(reason, stamp_ns)
        elif angle_deg is not None:
            self._wanted = _Wanted(angle_deg=angle_deg, servo=servo)
            self._renewed_s = time.monotonic()

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
        if (other := self.node.other(topics.STATE)) is not None:
            return self._commands.drop("two stage nodes", f"{other}: both would turn; end one of them")
        if self._moving is not None and not (servo and self._moving.servo):
            return self._commands.drop("busy", "the stage is turning; wait until it is idle, or stop it first")
        return None

    def _refuse(self, reason: str, stamp_ns: int) -> None:
        self._refused = (reason, stamp_ns)
        now_s = time.monotonic()
        # A flood of bad commands is not answered one by one: the state that is due next says why.
        if now_s >= self._refusal_due_s:
            self._refusal_due_s = now_s + _REFUSAL_S
            self._publish_state(is_busy=self._moving is not None)
            self._say(topics.WARNING, reason)

    def stop(self) -> None:
        """End the move; what was asked for and not begun is forgotten."""
        self._wanted = None
        self._stopped = True
        self._stops += 1

    def beat(self) -> None:
        """End the move if that is wanted; called while the stage turns, after the messages have been handled.

        Raises `StepEnded` if somebody stops it, a servo command was not renewed, or a newer one has another target.
        """
        if self._moving is None:
            return
        seen_deg = self._stage.seen_deg if isinstance(self._stage, _SeenOnItsWay) else math.nan
        if time.monotonic() >= self._due_s and math.isfinite(seen_deg):
            self._due_s = time.monotonic() + _TURNING_S
            self._publish_seen(seen_deg, time_s=self.node.now_s())
        if self._moving.servo and self._unrenewed():
            self.stop()
        if self._stopped or (self._wanted is not None and not self._on_the_way(self._wanted.angle_deg, seen_deg)):
            raise StepEnded

    def _unrenewed(self) -> bool:
        return time.monotonic() - self._renewed_s > _RENEW_S

    def _on_the_way(self, angle_deg: float, seen_deg: float) -> bool:
        """Whether the present move leads to an angle, or to one before it, and may go on."""
        assert self._moving is not None  # noqa: S101  asked during a move only
        target_deg = self._moving.angle_deg
        # Where the angle is unknown this is False: the move is ended.
        return angle_deg == target_deg or (target_deg - seen_deg) * (angle_deg - target_deg) > 0

    # What the node does between two moves.

    def step(self) -> None:
        """Carry out the last command, and publish angle, state and diagnostics when they are due."""
        self._stopped = False
        wanted, self._wanted = self._wanted, None
        if wanted is not None and not (wanted.servo and self._unrenewed()):
            self._move(wanted)
        elif time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + _PUBLISH_S
            self._publish_angle()
        self._diagnose({"angle_deg": f"{self._angle_deg:.3f}", "moves": self._moves, "stops": self._stops})

    def _move(self, wanted: _Wanted) -> None:
        self._moving = wanted
        self._moves += 1
        self._publish_setpoint(wanted.angle_deg)
        self._publish_state(is_busy=True)
        try:
            self._turn(wanted.angle_deg)
        except StepEnded:
            # It holds where it stands, whatever it was sent to.
            self._setpoint_deg = math.nan
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
        self._due_s = -math.inf
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

    def _fail(self, error: MarkerseekError) -> None:
        super()._fail(error)
        self._say(topics.ERROR, self._guard.fault or "")

    # What it publishes.

    def _publish_angle(self) -> None:
        """Publish the angle read back, and that the stage is idle, with one stamp."""
        # Between two targets of a servo it only changes its way.
        is_busy = self._wanted is not None
        try:
            self._angle_deg = self._guard.readback(self._stage.angle_deg)
        except MarkerseekError as error:
            self._fail(error)
            self._publish_state(is_busy=False)
            return
        now_s = self.node.now_s()
        self._publish_setpoint(self._angle_deg if math.isnan(self._setpoint_deg) else self._setpoint_deg)
        self._publish_seen(self._angle_deg, time_s=now_s)
        self._publish_state(is_busy=is_busy, stamp_ns=messages.time_ns(now_s))

    def _publish_seen(self, angle_deg: float, *, time_s: float) -> None:
        node, kinds = self.node, self.node.kinds
        node.publish(topics.MEASURED_JS, messages.joint_state(kinds, time_s=time_s, angle_deg=angle_deg))
        node.publish(topics.MEASURED_CP, messages.pose(kinds, time_s=time_s, angle_deg=angle_deg))
        turned = messages.transforms(kinds, time_s=time_s, angle_deg=angle_deg, images={}, face_radius_m=None)
        publish_frames(node, topics.FRAMES, turned)

    def _publish_setpoint(self, angle_deg: float) -> None:
        self._setpoint_deg = angle_deg
        message = messages.joint_state(self.node.kinds, time_s=self.node.now_s(), angle_deg=angle_deg)
        self.node.publish(topics.SETPOINT_JS, message)

    def _say(self, topic: str, sentence: str) -> None:
        if self._speaks_crtk:
            self.node.publish(topic, messages.crtk_string(self.node.kinds, sentence, time_s=self.node.now_s()))

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
        self.node.publish(topics.STATE, messages.text(self.node.kinds, held))
        if self._speaks_crtk:
            self.node.publish(topics.OPERATING_STATE, messages.crtk_state(self.node.kinds, held))
