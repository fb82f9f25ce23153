"""Encoders of a probe that a person turns: a TRANSFORM of OpenIGTLink, or a ROS 2 topic."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from markerseek.core import Clock, Float64, MoveError
from markerseek.drivers.plus import VERSION_CURE, IgtlMessages, connect_plus
from markerseek.ros import RosNode, joint_angle_deg, messages, reach, topics
from markerseek.wire import igtl

AXES = ("x", "y", "z")
"""Names of the axes of a transform, in order."""

MAX_TILT = 0.02
"""Largest tilt of the axis of rotation in a transform, as a sine: about one degree."""

MAX_SHIFT_MM = 2.0
"""Largest shift of the probe in a transform, in millimetres: a search assumes that the probe only turns."""

_MAX_WAITING = 200
"""Most messages of ROS 2 that are handled for one angle."""


def rotation_deg(matrix: Float64[np.ndarray, "4 4"], *, axis: int) -> float:
    """Angle in degrees by which a transform turns about one of its axes; `MoveError` if it does anything else."""
    turn = matrix[:3, :3]
    # Matrices travel in single precision.
    if not (np.abs(turn.T @ turn - np.eye(3)).max() < 1e-3 and np.linalg.det(turn) > 0):
        raise MoveError("stage: the transform of its encoder is no rotation; check the encoder")
    tilt = float(np.linalg.norm(np.delete(turn[:, axis], axis)))
    if not (turn[axis, axis] > 0 and tilt < MAX_TILT):
        raise MoveError(
            f"stage: the transform of its encoder turns about another axis than {AXES[axis]} (sine {tilt:.2g}); "
            "correct stage.axis, or name the transform between the probe and its home"
        )
    after, last = (axis + 1) % 3, (axis + 2) % 3
    return math.degrees(math.atan2(turn[last, after], turn[after, after]))


class _Transforms:
    """The rotation of successive transforms, which must not shift the probe."""

    def __init__(self, axis: int) -> None:
        self._axis = axis
        self._place_mm: Float64[np.ndarray, " 3"] | None = None

    def angle_deg(self, matrix: Float64[np.ndarray, "4 4"]) -> float:
        """Angle of a transform in degrees; its lengths are in millimetres."""
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
        """Whether a message is current: later than the last one, not too old, and not from the future."""
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
            self.unused, self._last_s = "", stamp_s
            return True
        return False


class IgtlEncoder(IgtlMessages):
    """A TRANSFORM of a PLUS server, or of another server of OpenIGTLink.

    Only the newest message counts, and only if its time stamp is current. ``device``: name of the TRANSFORM. ``axis``:
    index of the axis of rotation. ``states``: whether the metadata of each message must state that it is valid.
    ``unix_s``: returns the time of day in seconds since 1970, as in the messages. ``emulated``: whether the server says
    that it is an emulator. Raises `NotConnectedError` if no server answers.
    """

    driver, peer, content = "stage", "server of its encoder", "TRANSFORM"

    def __init__(
        self,
        *,
        clock: Clock,
        host: str,
        port: int,
        connect_s: float,
        device: str,
        axis: int,
        age_s: float,
        states: bool = True,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        connection = connect_plus(host, port, within_s=connect_s, driver=self.driver)
        super().__init__(connection, clock, device=device)
        self._unix_s, self._states = unix_s, states
        self._transforms, self._stamps = _Transforms(axis), _Stamps(age_s)
        self._said = ""

    @property
    def unused(self) -> str:
        """Why the last message was not used; empty if it was."""
        return self._said or self._stamps.unused

    def read(self) -> float | None:
        """Newest angle since the last call, in degrees; None if there is none.

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
        """Why a transform is rejected; empty if it is not. A server may repeat its last matrix as INVALID."""
        status = transform.metadata.get("TransformStatus")
        if status is None and self._states:
            said = "its transform does not state by TransformStatus in its metadata that it is valid"
            if transform.version == 1:
                return f"{said}: it came in header version 1; {VERSION_CURE}, or set stage.require_status = false"
            return f"{said}; let the server send it, or set stage.require_status = false if it never can"
        if status not in (None, "OK"):
            return f"it says that its transform is {status[:20]!r}"
        known = isinstance(transform.content, igtl.Transform) and transform.content.matrix is not None
        return "" if known else "its transform is NaN"


class Ros2Encoder:
    """An angle on a ROS 2 topic: a joint in radians, or a transform.

    ``axis``: index of the axis of rotation of a transform; None for a joint.
    """

    def __init__(self, *, node: RosNode, topic: str, axis: int | None, age_s: float) -> None:
        self._node, self._topic = node, topic
        self._transforms = None if axis is None else _Transforms(axis)
        self._stamps = _Stamps(age_s)
        self._newest: Any = None
        self.emulated = False
        kind = "sensor_msgs/msg/JointState" if axis is None else "geometry_msgs/msg/TransformStamped"
        node.subscribe(topic, kind, self._on_message)
        # Our nodes state on this topic whether they are simulated; other nodes have no such topic.
        node.subscribe(topics.beside(topic, topics.STATE), "std_msgs/msg/String", self._on_state)

    def _on_message(self, message: Any) -> None:
        self._newest = message

    def _on_state(self, message: Any) -> None:
        state = messages.state_of(message)
        self.emulated = self.emulated or (state is not None and state.simulated)

    @property
    def unused(self) -> str:
        """Why the last message was not used; empty if it was."""
        if self._node.publishes(self._topic):
            return self._stamps.unused
        return f"nobody publishes {self._topic}; its node is looked for in {reach()}"

    def read(self) -> float | None:
        """Newest angle since the last call, in degrees; None if there is none; NaN if the message holds no angle."""
        self._node.drain(_MAX_WAITING)
        message, self._newest = self._newest, None
        if message is None or not self._stamps.is_used(messages.stamp_ns(message) * 1e-9, self._node.now_s()):
            return None
        if self._transforms is None:
            angle_deg = joint_angle_deg(message)
            return math.nan if angle_deg is None else angle_deg
        return self._transforms.angle_deg(_matrix(message.transform))


def _matrix(transform: Any) -> Float64[np.ndarray, "4 4"]:
    """Matrix of a geometry_msgs/Transform, in millimetres; NaN if the quaternion has another length than 1."""
    from scipy.spatial.transform import Rotation

    turn, place = transform.rotation, transform.translation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    matrix = np.eye(4)
    # Without this check a quaternion of any length would be taken for a rotation.
    unit = abs(quaternion @ quaternion - 1) < 1e-3
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix() if unit else math.nan
    matrix[:3, 3] = 1e3 * place.x, 1e3 * place.y, 1e3 * place.z
    return matrix
