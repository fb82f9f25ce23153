"""Drivers of devices behind ROS 2 topics: a stage node, and an acquisition node, which is laser and receiver."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Any, Literal

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceTimeoutError,
    Interval,
    MoveError,
    NotConnectedError,
    Within,
)
from markerseek.drivers._ros2_acquisition import LASER_ENTRY, RECEIVER_ENTRY
from markerseek.drivers._ros2_waiting import STATE_S, require_found, wait_until
from markerseek.drivers.entry import Entry, Opening, StageKeys
from markerseek.drivers.standard_stage import require_inside
from markerseek.ros import RosNode, degrees, joint_angle_deg, messages, topics

__all__ = ["LASER_ENTRY", "RECEIVER_ENTRY", "STAGE_ENTRY", "Ros2Stage", "Ros2StageSettings"]

_TEXT = "std_msgs/msg/String"

_MAX_WAITING = 200
"""Most messages that are handled before a move, or before the angle is given."""


class Ros2StageSettings(StageKeys, frozen=True, kw_only=True, tag="ros2"):
    """A stage node that takes an angle on one topic and returns the angle reached on another."""

    command_topic: str = topics.MOVE_JP
    reached_topic: str = topics.MEASURED_JS
    """``command_topic`` and ``reached_topic``: where the angle to go to is published, and where the angle reached is
    read."""
    state_topic: str | None = topics.STATE
    """State of the node: a move ends when it is busy and then idle. JSON in a String, as of ours, or CRTK's
    operating_state. None: the move ends with an angle near the target."""
    message: Literal["joint_state", "float64"] = "joint_state"
    """Type of both: ``joint_state``, in radians and with a stamp, or ``float64``, as of a LabVIEW bridge."""
    unit: Literal["rad", "deg"] = "rad"
    """Unit of ``float64``."""
    joint: str = messages.JOINT
    """Name of the stage's joint in a ``joint_state``; other joints of the same message are not read."""
    connect_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 10.0
    """Longest time until its node is found."""
    timeout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 60.0
    """Longest duration of a move."""
    arrival_deg: Annotated[float, Within(0.001, 0.1, "deg")] = 0.05
    """Largest distance from the target at which an angle counts as reached."""
    age_s: Annotated[float | None, Within(0.05, 60, "s")] = 1.0
    """Greatest age of an angle; None for nodes that publish it after a move only."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.message == "joint_state" and self.unit != "rad":
            raise ConfigError("stage: unit is deg, and a joint_state is in radians; use message = 'float64', or 'rad'")
        if self.message == "float64" and self.state_topic is not None:
            raise ConfigError("stage: message is float64, and such nodes publish no state; add state_topic = 'none'")


class Ros2Stage:
    """A stage node of this or another program.

    ``settings``: its keys in the rig file. ``travel``: angles that it may be sent to. ``emulated``: whether the node
    says that it is simulated. Raises `NotConnectedError` if there is no such node, or it says no angle.
    """

    def __init__(self, *, node: RosNode, clock: Clock, settings: Ros2StageSettings, travel: Interval) -> None:
        self.limits = travel
        self._node = node
        self._clock = clock
        self._settings = settings
        self._wait_until = partial(wait_until, node, clock)
        self._angle_deg = math.nan
        self._heard_s = -math.inf
        self._reached_ns = 0
        self._readings = 0
        self._in_degrees = False
        self._states = 0
        self._listens_since_s: float | None = None
        self._joints: list[str] = []
        self._joints_since_s = math.inf
        self.emulated = False
        self._busy = False
        self._was_busy = False
        self._commanded = False
        self._idle_ns = 0
        self._refused: tuple[int, str] | None = None
        joint = settings.message == "joint_state"
        kind = "sensor_msgs/msg/JointState" if joint else "std_msgs/msg/Float64"
        node.advertise(settings.command_topic, kind)
        node.subscribe(settings.reached_topic, kind, self._on_joint if joint else self._on_number)
        self._stop_topic = topics.beside(settings.command_topic, topics.STOP)
        if settings.state_topic is not None:
            node.advertise(self._stop_topic, "std_msgs/msg/Empty")
        self._connect()

    def _connect(self) -> None:
        settings = self._settings
        for what, found in (
            (f"takes angles on {settings.command_topic}", lambda: self._node.matched(settings.command_topic)),
            (f"publishes an angle on {settings.reached_topic}", self._finds_angle),
            (f"publishes its state on {settings.state_topic}", self._finds_state),
        ):
            require_found(
                self._node,
                self._clock,
                found,
                missing=f"stage: no node {what}",
                cure="start it, and compare topics and message types",
                connect_s=settings.connect_s,
            )

    def _finds_angle(self) -> bool:
        """Return whether an angle has come; `NotConnectedError` if angles come, and none is of the stage's joint."""
        waited_s = self._clock.now_s() - self._joints_since_s
        if math.isnan(self._angle_deg) and waited_s >= (STATE_S if self._readings == 0 else 0.0):
            settings = self._settings
            raise NotConnectedError(
                f"stage: {settings.reached_topic} has the joints {', '.join(self._joints)}, and no number of "
                f"{settings.joint!r}; set stage.joint to the name of the joint that turns the probe"
            )
        return self._readings > 0

    def _finds_state(self) -> bool:
        """Return whether a state has come or is not needed; the publisher decides the type of its message.

        A node that publishes its state when it changes says nothing until it is sent somewhere.
        """
        topic = self._settings.state_topic
        node = self._node
        if topic is None or self._states > 0:
            return True
        kind = node.kind_of(topic)
        if self._listens_since_s is not None:
            return self._clock.now_s() - self._listens_since_s >= STATE_S and node.publishes(topic)
        if kind is not None:
            if kind not in (_TEXT, messages.CRTK_STATE) or not messages.is_installed(kind):
                raise NotConnectedError(
                    f"stage: {topic} is a {kind}, and {_TEXT} or {messages.CRTK_STATE} is understood; name another "
                    "state_topic, or install crtk_msgs"
                )
            self._listens_since_s = self._clock.now_s()
            node.subscribe(topic, kind, self._on_state, latched=node.is_kept(topic))
        return False

    def _on_number(self, message: Any) -> None:
        self._take(message.data if self._settings.unit == "deg" else degrees(message.data))

    def _on_joint(self, message: Any) -> None:
        if self._in_degrees:
            # The node's state has the same angle, not rounded by the way over radians.
            return
        if not self._names_joint(list(message.name)):
            return
        angle_deg = joint_angle_deg(message, joint=self._settings.joint)
        self._reached_ns = messages.stamp_ns(message)
        # What is no angle is kept as NaN, which the guard refuses.
        self._take(math.nan if angle_deg is None else angle_deg)

    def _names_joint(self, names: list[str]) -> bool:
        """Return whether a message may be of the stage: several nodes may use one topic, each for its own joints."""
        if not self._joints and names:
            self._joints_since_s = self._clock.now_s()
        self._joints += [name for name in names if name not in self._joints]
        return not names or self._settings.joint in names

    def _take(self, angle_deg: float) -> None:
        self._angle_deg = angle_deg
        self._heard_s = self._clock.now_s()
        self._readings += 1

    def _on_state(self, message: Any) -> None:
        state = messages.state_of(message)
        if state is None:
            return
        self._states += 1
        self.emulated = state.simulated
        self._busy = state.is_busy
        self._was_busy = self._was_busy or state.is_busy
        if not state.is_busy:
            self._idle_ns = state.stamp_ns
        if state.angle_deg is not None:
            self._in_degrees = True
            self._reached_ns = state.stamp_ns
            self._take(state.angle_deg)
        self._refused = (state.refused_ns, state.refused) if state.refused else self._refused

    @property
    def angle_deg(self) -> float:
        """Angle of the last message in degrees.

        Raises `DeviceTimeoutError` if it is older than ``age_s``.
        """
        self._node.drain(_MAX_WAITING)
        age_s = self._settings.age_s
        if age_s is not None:

            def fresh() -> bool:
                return self._clock.now_s() - self._heard_s <= age_s

            if not self._wait_until(fresh, timeout_s=age_s, of=self._settings.reached_topic):
                raise DeviceTimeoutError(
                    f"stage: no angle on {self._settings.reached_topic} for more than {age_s:g} s; its node is gone "
                    "or busy"
                )
        return self._angle_deg

    def move_to(self, angle_deg: float) -> float:
        """Send it to an angle, wait until it has arrived, and return the angle read back in degrees.

        Raises `LimitError` if the angle is NaN or outside the travel range; nothing was sent. Raises `MoveError` if the
        node refuses the angle. Raises `NotConnectedError` if the node is gone. Raises `DeviceTimeoutError` if it does
        not arrive in time.
        """
        require_inside(self.limits, angle_deg)
        self._node.drain(_MAX_WAITING)
        self._was_busy = False
        self._refused = None
        readings = self._readings
        self._commanded = True
        sent_ns = self._send(angle_deg)

        def ended() -> bool:
            if self._refused is not None and self._refused[0] == sent_ns:
                return True
            if self._settings.state_topic is not None:
                # Busy, then idle: idle alone may be from before the command.
                return self._was_busy and not self._busy and self._reached_ns >= self._idle_ns
            near = abs(self._angle_deg - angle_deg) <= self._settings.arrival_deg
            return self._readings > readings and near

        if not self._wait_until(ended, timeout_s=self._settings.timeout_s, of=self._settings.reached_topic):
            self._require_one_clock()
            raise DeviceTimeoutError(
                f"stage: sent to {angle_deg:.3f} deg, it did not arrive within {self._settings.timeout_s:g} s; its "
                f"last angle is {self._angle_deg:.3f} deg; look at the stage and its node"
            )
        self._commanded = False
        if self._refused is not None and self._refused[0] == sent_ns:
            raise MoveError(f"stage: its node refuses {angle_deg:.3f} deg: {self._refused[1]}")
        return self._angle_deg

    def _require_one_clock(self) -> None:
        """Name the stamps, if the stage has been busy and is idle, and no angle is stamped later than that."""
        if self._settings.state_topic is None or not self._was_busy or self._busy:
            return
        reached_s = 1e-9 * self._reached_ns
        idle_s = 1e-9 * self._idle_ns
        now_s = self._node.now_s()
        if reached_s < idle_s:
            raise DeviceTimeoutError(
                f"stage: it was busy and is idle again, but its last angle is stamped {reached_s:.3f} s and its state "
                f"{idle_s:.3f} s, where it is {now_s:.3f} s: an angle from after the move cannot be told from one of "
                "before; have its node stamp both with this computer's time (no 0, no simulation time)"
            )

    def _send(self, angle_deg: float) -> int:
        """Publish a command; returns its stamp in nanoseconds, 0 if it has none."""
        if self._settings.message == "float64":
            value = angle_deg if self._settings.unit == "deg" else math.radians(angle_deg)
            self._node.publish(self._settings.command_topic, messages.number(value))
            return 0
        settings = self._settings
        message = messages.joint_state(time_s=self._node.now_s(), angle_deg=angle_deg, joint=settings.joint)
        self._node.publish(self._settings.command_topic, message)
        return messages.stamp_ns(message)

    def stop(self) -> None:
        """Ask the node to stop, if it publishes its state; a plain node ends its move by itself."""
        # A command that was sent a moment ago moves the stage before its node says that it is busy.
        if self._settings.state_topic is not None and (self._busy or self._commanded):
            self._node.publish(self._stop_topic, messages.empty())


def _open_stage(settings: Ros2StageSettings, opening: Opening) -> Ros2Stage:
    return Ros2Stage(node=opening.node(), clock=opening.clock, settings=settings, travel=opening.limits.travel)


STAGE_ENTRY: Entry[Ros2StageSettings, Ros2Stage] = Entry(
    settings=Ros2StageSettings,
    open=_open_stage,
    describe=lambda settings, stage: f"{'SIMULATED ' if stage.emulated else ''}stage node on {settings.command_topic}",
    is_node=True,
)
