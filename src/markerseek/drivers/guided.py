"""Driver of a stage without a motor: a person turns the probe, and an encoder reports where it is.

A move asks the person, and ends when the angle has been steady for a while near the one asked for. Where the rig has
no encoder, the person reads a scale and types the angle in (`TypedStage`).
"""

from __future__ import annotations

import math
import os
import select
import sys
import termios
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from typing import Annotated, Any, Literal, Protocol

import numpy as np

from markerseek.core import (
    ByHand,
    Clock,
    ConfigError,
    DeviceTimeoutError,
    Float64,
    Interval,
    MoveError,
    NotConnectedError,
    Stage,
    Turning,
    Within,
    is_finite,
)
from markerseek.drivers.entry import Entry, Opening, StageKeys
from markerseek.drivers.plus import VERSION_CURE, IgtlMessages, connect_plus, require_device
from markerseek.drivers.standard_stage import require_inside
from markerseek.guard import Limits
from markerseek.ros import RosNode, joint_angle_deg, messages, set_up_discovery, topics
from markerseek.wire import igtl

_SLICE_S = 0.02
"""Time between two looks for a new angle, in seconds."""

_LINE_BYTES = 4096
"""Longest line of a terminal."""

_SHOWN_S = 0.2
"""Time between two angles that are shown to the person, in seconds."""

_AXES = ("x", "y", "z")
"""Names of the axes of a transform, in order."""

MAX_TILT = 0.02
"""Largest tilt of the axis of rotation in a transform, as a sine: about one degree."""

MAX_SHIFT_MM = 2.0
"""Largest shift of the probe in a transform, in millimetres: a search assumes that the probe only turns."""

_MAX_WAITING = 200
"""Most messages of ROS 2 that are handled for one angle."""


class GuidedStageSettings(StageKeys, frozen=True, kw_only=True, tag="guided"):
    """A probe that a person turns."""

    encoder: Literal["openigtlink", "ros2", "typed", "simulated"] = "openigtlink"
    """What reports the angle: a TRANSFORM of a PLUS server or another one of OpenIGTLink, a ROS 2 topic, the person who
    types it, or a simulated hand, to try it without hardware."""
    device: str = "ProbeToProbeHome"
    host: str = "127.0.0.1"
    port: Annotated[int, Within(1, 65535)] = 18944
    """``device``, ``host`` and ``port``: name of the TRANSFORM, and where its server is."""
    require_status: bool = True
    """Whether a TRANSFORM must state by ``TransformStatus`` in its metadata, or by ``TransformValid`` of older servers,
    that it is valid, as those of PLUS do; False for a server that never does, where a tracker that sees nothing looks
    like a probe at rest. What a transform does state counts always."""
    topic: str = topics.MEASURED_JS
    joint: str = messages.JOINT
    """Name of the joint in a ``joint_state``; other joints of the same message are not read."""
    message: Literal["joint_state", "transform"] = "joint_state"
    """``topic`` and ``message``: where the angle is published in ROS 2, and whether as sensor_msgs/JointState, in
    radians, or as geometry_msgs/TransformStamped."""
    axis: Literal["x", "y", "z"] = "y"
    """Axis of a transform about which the probe turns."""
    zero_deg: Annotated[float, Within(-360, 360, "deg")] = 0.0
    """The encoder's own reading at which the image plane points at 0."""
    direction: Literal["forward", "reverse"] = "forward"
    """``reverse`` if the probe's angle falls while the encoder's reading grows, as for a transform that maps the other
    way (PLUS: ProbeHomeToProbe)."""
    connect_s: Annotated[float, Within(0.1, 600, "s")] = 10.0
    """Longest time until the encoder reports an angle."""
    timeout_s: Annotated[float, Within(1, 3600, "s")] = 120.0
    """Longest time in which the person turns the probe to an angle."""
    age_s: Annotated[float, Within(0.05, 5, "s")] = 0.5
    """Greatest age of an angle, by the time that its message carries and by this computer's."""
    fastest_deg_s: Annotated[float, Within(5, 360, "deg/s")] = 90.0
    """Fastest that a hand turns the probe: an angle that changes faster has jumped."""
    steady_s: Annotated[float, Within(0.2, 10, "s")] = 1.0
    steady_deg: Annotated[float, Within(0.01, 1, "deg")] = 0.2
    """``steady_s`` and ``steady_deg``: the probe is at rest once its angle has changed by no more for so long."""
    reach_deg: float = 1.0
    """Most that the angle reached may differ from the one asked for; the search takes the one reached."""
    drift_deg: float = 0.3
    """Most that the angle may change during an acquisition, until its frame is read."""
    step_deg: float = 1.0
    """Angles asked for are multiples of it."""
    reversal_deg: float = 150.0
    """Rotation that is as much effort as turning back."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_device(self.device, part="stage")
        if self.steady_deg >= self.by_hand.reach_deg:
            raise ConfigError(
                f"stage: steady_deg is {self.steady_deg} deg and reach_deg {self.reach_deg} deg; what is at rest must "
                "be finer than what counts as reached"
            )

    @property
    def by_hand(self) -> ByHand:
        """What search and guard know of the hand."""
        return ByHand(
            step_deg=self.step_deg,
            reversal_deg=self.reversal_deg,
            reach_deg=self.reach_deg,
            drift_deg=self.drift_deg,
        )


class Encoder(Protocol):
    """Reports the angle of a probe that somebody else turns."""

    @property
    def emulated(self) -> bool:
        """Whether it says that it is an emulator, or simulated."""

    @property
    def unused(self) -> str:
        """Why the last message is of no use; empty if it is not so."""

    def read(self) -> float | None:
        """Return the newest angle since the last call, in degrees of its own; None if there is none."""


def rotation_deg(matrix: Float64[np.ndarray, "4 4"], *, axis: int) -> float:
    """Return the angle in degrees by which a transform turns about one of its axes.

    `MoveError` if it does anything else.
    """
    turn = matrix[:3, :3]
    # Matrices travel in single precision.
    if not (np.abs(turn.T @ turn - np.eye(3)).max() < 1e-3 and np.linalg.det(turn) > 0):
        raise MoveError("stage: the transform of its encoder is no rotation; check the encoder")
    tilt = float(np.linalg.norm(np.delete(turn[:, axis], axis)))
    if not (turn[axis, axis] > 0 and tilt < MAX_TILT):
        raise MoveError(
            f"stage: the transform of its encoder turns about another axis than {_AXES[axis]} (sine {tilt:.2g}); "
            "correct stage.axis, or name the transform between the probe and its home"
        )
    after = (axis + 1) % 3
    last = (axis + 2) % 3
    return math.degrees(math.atan2(turn[last, after], turn[after, after]))


class _Transforms:
    """The rotation of successive transforms, which must not shift the probe."""

    def __init__(self, axis: Literal["x", "y", "z"]) -> None:
        self._axis = _AXES.index(axis)
        self._place_mm: Float64[np.ndarray, " 3"] | None = None

    def angle_deg(self, matrix: Float64[np.ndarray, "4 4"]) -> float:
        """Return the angle of a transform in degrees; its lengths are in millimetres."""
        angle_deg = rotation_deg(matrix, axis=self._axis)
        place_mm = matrix[:3, 3]
        if self._place_mm is None:
            self._place_mm = place_mm.copy()
        shift_mm = float(np.linalg.norm(place_mm - self._place_mm))
        if not shift_mm <= MAX_SHIFT_MM:
            raise MoveError(
                f"stage: the probe was shifted by {shift_mm:.1f} mm since the search began, {MAX_SHIFT_MM:g} mm is the "
                "limit: the earlier samples belong to another place; put the probe back, or begin a new search"
            )
        return angle_deg


class _Stamps:
    """Decides by the time stamps which messages are new and current."""

    def __init__(self, age_s: float) -> None:
        self._age_s = age_s
        self._last_s = -math.inf
        self.unused = ""

    def is_used(self, stamp_s: float, now_s: float) -> bool:
        """Return whether a message is current: later than the last one, not too old, and not from the future."""
        if stamp_s == self._last_s:
            # A server may repeat its last message; `unused` says so if no other message comes.
            self.unused = "its messages repeat one time stamp"
            return False
        apart_s = now_s - stamp_s
        if stamp_s <= 0:
            self.unused = "its messages carry no time; let the server state it"
        elif stamp_s < self._last_s:
            self.unused = "the time of its messages runs backwards"
        elif not abs(apart_s) <= self._age_s:
            side = "old" if apart_s > 0 else "ahead of this computer's clock"
            self.unused = f"its messages are {abs(apart_s):.2f} s {side}; compare the two clocks, and check the network"
        else:
            self.unused = ""
            self._last_s = stamp_s
            return True
        return False


class IgtlEncoder(IgtlMessages):
    """A TRANSFORM of a PLUS server, or of another server of OpenIGTLink.

    Only the newest message counts, and only if its time stamp is current. ``unix_s``: returns the time of day in
    seconds since 1970, as in the messages. ``emulated``: whether the server says that it is an emulator. Raises
    `NotConnectedError` if no server answers.
    """

    driver = "stage"
    peer = "server of its encoder"
    content = "TRANSFORM"

    def __init__(
        self,
        *,
        clock: Clock,
        settings: GuidedStageSettings,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        connection = connect_plus(settings.host, settings.port, within_s=settings.connect_s, driver=self.driver)
        super().__init__(connection, clock, device=settings.device)
        self._unix_s = unix_s
        self._states = settings.require_status
        self._transforms = _Transforms(settings.axis)
        self._stamps = _Stamps(settings.age_s)
        self._said = ""

    @property
    def unused(self) -> str:
        """Why the last message was not used; empty if it was."""
        return self._said or self._stamps.unused or self.other_devices.removeprefix("; ")

    def read(self) -> float | None:
        """Return the newest angle since the last call, in degrees; None if there is none.

        Raises `MoveError` if the transform is no rotation about the axis, or shifts the probe. Raises
        `NotConnectedError` if the connection has ended, or what comes is no OpenIGTLink.
        """
        came, _ = self.take()
        if not came:
            return None
        newest = came[-1]
        assert isinstance(newest.content, igtl.Transform)  # noqa: S101  by the kind in its header
        matrix = newest.content.matrix
        self._said = self._objection(newest)
        if self._said or matrix is None or not self._stamps.is_used(newest.time_s, self._unix_s()):
            return None
        return self._transforms.angle_deg(matrix)

    def _objection(self, transform: igtl.Message) -> str:
        """Return why a transform is rejected; empty if it is not. A server may repeat its last matrix as INVALID."""
        status, valid = (transform.metadata.get(f"Transform{name}") for name in ("Status", "Valid"))
        if status is None and valid is None and self._states:
            said = "its transform does not state by TransformStatus in its metadata that it is valid"
            if transform.version == 1:
                return f"{said}: it came in header version 1; {VERSION_CURE}"
            return f"{said}; let the server send it, as PLUS does"
        if status not in (None, "OK"):
            return f"it says that its transform is {status[:20]!r}"
        if valid is not None and valid.strip().lower() not in ("1", "true"):
            return f"it says that its transform is not valid: TransformValid is {valid[:20]!r}"
        known = isinstance(transform.content, igtl.Transform) and transform.content.matrix is not None
        return "" if known else "its transform is NaN"


class Ros2Encoder:
    """An angle on a ROS 2 topic: a joint in radians, or a transform."""

    def __init__(self, *, node: RosNode, settings: GuidedStageSettings) -> None:
        self._node = node
        self._topic = settings.topic
        self._joint = settings.joint
        self._joints = ""
        self._transforms = _Transforms(settings.axis) if settings.message == "transform" else None
        self._stamps = _Stamps(settings.age_s)
        self._newest: Any = None
        self.emulated = False
        kind = "sensor_msgs/msg/JointState" if self._transforms is None else "geometry_msgs/msg/TransformStamped"
        node.subscribe(self._topic, kind, self._on_message)
        # Our nodes state on this topic whether they are simulated; other nodes have no such topic.
        node.subscribe(topics.beside(self._topic, topics.STATE), "std_msgs/msg/String", self._on_state)

    def _on_message(self, message: Any) -> None:
        names = list(message.name) if self._transforms is None else []
        if names and self._joint not in names:
            # Several nodes may use one topic, each for its own joints.
            self._note_joints(names)
            return
        self._newest = message

    def _note_joints(self, names: Sequence[str]) -> None:
        self._joints = f"its message has the joints {', '.join(names)}, and no number of {self._joint!r}"

    def _on_state(self, message: Any) -> None:
        state = messages.state_of(message)
        self.emulated = self.emulated or (state is not None and state.simulated)

    @property
    def unused(self) -> str:
        """Why the last message was not used; empty if it was."""
        if self._node.publishes(self._topic):
            return self._stamps.unused or self._joints
        return f"nobody publishes {self._topic}; its node is looked for in {set_up_discovery()}"

    def read(self) -> float | None:
        """Return the newest angle since the last call, in degrees.

        None if there is none; NaN if the message holds no angle.
        """
        self._node.drain(_MAX_WAITING)
        message = self._newest
        self._newest = None
        if message is None or not self._stamps.is_used(messages.stamp_ns(message) * 1e-9, self._node.now_s()):
            return None
        if self._transforms is None:
            angle_deg = joint_angle_deg(message, joint=self._joint)
            if angle_deg is not None:
                return angle_deg
            self._note_joints(message.name)
            return math.nan
        return self._transforms.angle_deg(_matrix(message.transform))


def _matrix(transform: Any) -> Float64[np.ndarray, "4 4"]:
    """Return the matrix of a geometry_msgs/Transform, in millimetres.

    NaN if the quaternion has another length than 1.
    """
    from scipy.spatial.transform import Rotation

    turn = transform.rotation
    place = transform.translation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    matrix = np.eye(4)
    # Without this check a quaternion of any length would be taken for a rotation.
    unit = abs(quaternion @ quaternion - 1) < 1e-3
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix() if unit else math.nan
    matrix[:3, 3] = 1e3 * place.x, 1e3 * place.y, 1e3 * place.z
    return matrix


def ask_on_terminal(angle_deg: float) -> None:
    """Ask the person at the terminal to turn the probe to an angle in degrees."""
    line = f"   turn the probe to {angle_deg:+.1f}°   "
    edge = "━" * len(line)
    sys.stderr.write(f"\n┏{edge}┓\n┃{line}┃\n┗{edge}┛\n")
    sys.stderr.flush()


class TurnedByHand(ABC):
    """A stage that a person turns.

    ``limits``: angles that may be searched, at which the probe must come to rest, and those at which it may be.
    ``asks``: asks the person for an angle in degrees.
    """

    def __init__(
        self, *, clock: Clock, settings: GuidedStageSettings, limits: Limits, asks: Callable[[float], None]
    ) -> None:
        self.limits: Interval = limits.travel
        self._search = limits.search
        self._clock = clock
        self._settings = settings
        self._asks = asks
        self._angle_deg = 0.0

    @abstractmethod
    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Ask the person, and report where the probe is until it has come to rest near the angle."""

    def move_to(self, angle_deg: float) -> float:
        """Let the person turn the probe there, and return the angle reached in degrees; raises as `guide`."""
        for _ in self.guide(angle_deg):
            pass
        return self._angle_deg

    def stop(self) -> None:  # noqa: B027  doing nothing is the whole of it
        """Nothing to stop: what a person does ends when the person ends it."""


class GuidedStage(TurnedByHand):
    """A probe that a person turns, and an encoder.

    Raises `NotConnectedError` if the encoder reports no angle.
    """

    def __init__(
        self,
        *,
        encoder: Encoder,
        clock: Clock,
        settings: GuidedStageSettings,
        limits: Limits,
        asks: Callable[[float], None] = ask_on_terminal,
    ) -> None:
        super().__init__(clock=clock, settings=settings, limits=limits, asks=asks)
        self._encoder = encoder
        self._read_s: float | None = None
        self._reached: tuple[float, float] | None = None
        if not self._reads_within(settings.connect_s):
            raise NotConnectedError(
                f"stage: no angle came from its encoder within {settings.connect_s:g} s{self._why}; start it, and "
                "compare its name and address with the rig file"
            )

    @property
    def emulated(self) -> bool:
        """Whether the encoder says that it is an emulator, or simulated."""
        return self._encoder.emulated

    @property
    def angle_deg(self) -> float:
        """Angle in degrees of a message that comes after the question.

        Raises `DeviceTimeoutError` if none comes in time, `MoveError` if the angle is not finite or has jumped.
        """
        # What waits was sent before.
        self._take()
        if not self._reads_within(self._settings.age_s):
            raise self._silent()
        return self._angle_deg

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Ask the person, and report where the probe is until it has come to rest near the angle.

        Nobody is asked to turn a probe that still is where it was turned for this angle. Raises `LimitError` if the
        angle is NaN or outside the travel range. Raises `DeviceTimeoutError` if the encoder is silent, or the probe
        does not come to rest there in time. Raises `MoveError` as `angle_deg`.
        """
        require_inside(self.limits, angle_deg, then="nobody was asked")
        start_deg = self.angle_deg
        if self._is_still_there(angle_deg):
            return
        self._reached = None
        self._asks(angle_deg)
        yield Turning(target_deg=angle_deg, angle_deg=start_deg)
        settings = self._settings
        began_s = self._clock.now_s()
        shown_s = began_s
        calm_s = began_s
        low_deg = start_deg
        high_deg = start_deg
        # An encoder that stands still would be near the next angle by chance: it must be seen to turn.
        turned = abs(start_deg - angle_deg) <= settings.steady_deg
        while True:
            if not self._reads_within(settings.age_s):
                raise self._silent()
            now_s = self._clock.now_s()
            here_deg = self._angle_deg
            turned = turned or abs(here_deg - start_deg) > settings.steady_deg
            low_deg = min(low_deg, here_deg)
            high_deg = max(high_deg, here_deg)
            if high_deg - low_deg > settings.steady_deg or not self._is_at(angle_deg):
                low_deg = here_deg
                high_deg = here_deg
                calm_s = now_s
            if turned and now_s - calm_s >= settings.steady_s:
                self._reached = angle_deg, here_deg
                return
            if not now_s - began_s <= settings.timeout_s:
                raise self._not_there(angle_deg, start_deg, turned=turned)
            if now_s - shown_s >= _SHOWN_S:
                shown_s = now_s
                yield Turning(target_deg=angle_deg, angle_deg=here_deg)

    def _is_at(self, angle_deg: float) -> bool:
        return abs(self._angle_deg - angle_deg) <= self._settings.reach_deg and self._angle_deg in self._search

    def _is_still_there(self, angle_deg: float) -> bool:
        """Return whether it was turned there before, and has not left."""
        if self._reached is None or self._reached[0] != angle_deg:
            return False
        return abs(self._angle_deg - self._reached[1]) <= self._settings.drift_deg and self._is_at(angle_deg)

    def _reads_within(self, wait_s: float) -> bool:
        """Return whether a new angle comes in that time."""
        ends_s = self._clock.now_s() + wait_s
        while self._clock.now_s() < ends_s:
            self._clock.wait(_SLICE_S)
            if self._take():
                return True
        return False

    def _take(self) -> bool:
        """Return whether the encoder has reported a new angle.

        `MoveError` if the angle is not finite, or has jumped.
        """
        read_deg = self._encoder.read()
        if read_deg is None:
            return False
        if not is_finite(read_deg):
            raise MoveError(
                f"stage: its encoder reports {read_deg} deg, which is no angle{self._why}; look at the encoder"
            )
        settings = self._settings
        sign = 1.0 if settings.direction == "forward" else -1.0
        # The encoder's zero may be anywhere on the circle.
        here_deg = (sign * (read_deg - settings.zero_deg) + 180.0) % 360.0 - 180.0
        now_s = self._clock.now_s()
        if self._read_s is not None:
            way_deg = abs(here_deg - self._angle_deg)
            elapsed_s = now_s - self._read_s
            if not way_deg <= settings.fastest_deg_s * elapsed_s + settings.steady_deg:
                raise MoveError(
                    f"stage: its angle jumped from {self._angle_deg:.2f} to {here_deg:.2f} deg in {elapsed_s:.3f} s, "
                    f"faster than a hand turns it ({settings.fastest_deg_s:g} deg/s); look at the encoder"
                )
        self._angle_deg = here_deg
        self._read_s = now_s
        return True

    @property
    def _why(self) -> str:
        return f" ({self._encoder.unused})" if self._encoder.unused else ""

    def _silent(self) -> DeviceTimeoutError:
        return DeviceTimeoutError(
            f"stage: its encoder has reported no angle for {self._settings.age_s:g} s{self._why}; look at the encoder "
            "and its server"
        )

    def _not_there(self, angle_deg: float, start_deg: float, *, turned: bool) -> DeviceTimeoutError:
        what = (
            f"asked for {angle_deg:.1f} deg, the probe did not come to rest there within {self._settings.timeout_s:g} s"
        )
        where = f"it is at {self._angle_deg:.2f} deg" if turned else f"its angle has stayed at {start_deg:.2f} deg"
        cure = "turn it there, and hold it" if turned else "turn it, or look at the encoder, which may stand still"
        return DeviceTimeoutError(f"stage: {what}: {where}; {cure}")


class TypedStage(TurnedByHand):
    """A probe that a person turns, and whose angle the same person types in.

    What was typed is all that is known: that the probe stays there during an acquisition is the person's word.

    Raises `NotConnectedError` if there is no terminal.
    """

    emulated = False

    def __init__(
        self,
        *,
        clock: Clock,
        settings: GuidedStageSettings,
        limits: Limits,
        asks: Callable[[float], None] = ask_on_terminal,
    ) -> None:
        super().__init__(clock=clock, settings=settings, limits=limits, asks=asks)
        if sys.stdin is None or not sys.stdin.isatty():
            raise NotConnectedError(
                "stage: encoder is 'typed', and there is no terminal to type the angle; start it in one"
            )
        self._terminal = sys.stdin.fileno()
        self._target_deg: float | None = None
        self._angle_deg = self._typed(
            "angle of the probe now, in degrees:\n", lambda angle_deg: angle_deg in self.limits
        )

    @property
    def angle_deg(self) -> float:
        """The angle that was typed last, in degrees."""
        return self._angle_deg

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Ask the person, and wait until an angle near the one asked for is typed.

        Nobody is asked again for the angle at which the probe was left. Raises `LimitError` if the angle is NaN or
        outside the travel range. Raises `DeviceTimeoutError` if none is typed in time. Raises `NotConnectedError` if
        the terminal has gone.
        """
        require_inside(self.limits, angle_deg, then="nobody was asked")
        if angle_deg == self._target_deg:
            return
        self._target_deg = None
        self._asks(angle_deg)
        yield Turning(target_deg=angle_deg, angle_deg=None)
        self._angle_deg = self._typed(
            f"angle reached, within {self._settings.reach_deg:g} of {angle_deg:+.1f} and in {self._search}:\n",
            lambda reached_deg: (
                abs(reached_deg - angle_deg) <= self._settings.reach_deg and reached_deg in self._search
            ),
        )
        self._target_deg = angle_deg

    def _typed(self, prompt: str, fits: Callable[[float], bool]) -> float:
        """Return the first number typed from now on that fits; the others are asked for again."""
        ends_s = self._clock.now_s() + self._settings.timeout_s
        while True:
            angle_deg = _number(self._line(prompt, ends_s=ends_s))
            # `fits` of NaN is False.
            if angle_deg is not None and fits(angle_deg):
                return angle_deg
            sys.stderr.write("that is no such angle; turn the probe further, or type it again\n")

    def _line(self, prompt: str, *, ends_s: float) -> str:
        line = b""
        try:
            # What was typed before the question is no answer to it.
            termios.tcflush(self._terminal, termios.TCIFLUSH)
            sys.stderr.write(prompt)
            sys.stderr.flush()
            while not line.endswith(b"\n"):
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(
                        f"stage: no angle was typed within {self._settings.timeout_s:g} s; begin again"
                    )
                self._clock.wait(_SLICE_S)
                if not select.select([self._terminal], [], [], 0)[0]:
                    continue
                piece = os.read(self._terminal, _LINE_BYTES)
                if not piece:
                    raise NotConnectedError("stage: the terminal has ended; no angle can be typed")
                line += piece
        except (OSError, termios.error) as problem:
            raise NotConnectedError("stage: the terminal has gone; no angle can be typed") from problem
        return line.decode("utf-8", "replace")


def _number(text: str) -> float | None:
    """Return the angle in a line, with a point or a comma; None if the line holds no angle."""
    try:
        angle_deg = float(text.strip().removesuffix("°").replace("−", "-").replace(",", "."))
    except ValueError:
        return None
    return angle_deg if is_finite(angle_deg) else None


def _open(settings: GuidedStageSettings, opening: Opening) -> Stage:
    clock = opening.clock
    limits = opening.limits
    if settings.encoder == "typed":
        return TypedStage(clock=clock, settings=settings, limits=limits)
    if settings.encoder == "simulated":
        hand = opening.simulated(settings)

        def asks(angle_deg: float) -> None:
            ask_on_terminal(angle_deg)
            hand.turn_to(angle_deg)

        return GuidedStage(encoder=hand, clock=clock, settings=settings, limits=limits, asks=asks)
    encoder: Encoder
    if settings.encoder == "ros2":
        encoder = Ros2Encoder(node=opening.node(), settings=settings)
    else:
        encoder = opening.stack.enter_context(closing(IgtlEncoder(clock=clock, settings=settings)))
    return GuidedStage(encoder=encoder, clock=clock, settings=settings, limits=limits)


def _describe(settings: GuidedStageSettings, _stage: Stage) -> str:
    if settings.encoder == "simulated":
        return "SIMULATED hand that turns the probe"
    of = {
        "openigtlink": f"{settings.device} of {settings.host}, port {settings.port}",
        "ros2": settings.topic,
        "typed": "typed in",
    }
    return f"probe turned by hand, its angle {of[settings.encoder]}"


ENTRY: Entry[GuidedStageSettings, Stage] = Entry(
    settings=GuidedStageSettings,
    open=_open,
    describe=_describe,
    same=("encoder", "device", "topic", "message", "axis", "zero_deg", "direction"),
    by_hand=lambda settings: settings.by_hand,
)
