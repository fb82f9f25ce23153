"""Poses that a robot or a tracker reports: of a ROS 2 topic, or a TRANSFORM of OpenIGTLink."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from markerseek.core import Clock, ConfigError, DeviceTimeoutError, Float64
from markerseek.drivers._ros2_waiting import require_found
from markerseek.drivers.clock import polls
from markerseek.drivers.plus import IgtlMessages, connect_plus
from markerseek.drivers.stereo_images import TOPIC
from markerseek.ros import RosNode
from markerseek.wire import igtl

CONNECT_S = 10.0
"""Longest wait for a node or a server, in seconds."""

POSE_KINDS = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
"""Messages that are read."""

_POLL_S = 0.02
"""Time between two looks for the first pose, in seconds."""

_MAX_WAITING = 100
"""Most messages that are read at once."""

_SERVER = re.compile(r"(?P<host>[^/\s]+):(?P<port>\d{1,5})/(?P<device>\S+)")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pose:
    """Where a frame is in another one, as one message says."""

    matrix: Float64[np.ndarray, "4 4"] | None
    """In millimetres; None: it is not valid."""
    stamp_s: float | None
    """Of when it is, on the sender's clock; None: the message does not say."""


class PoseReader(Protocol):
    """Reports where a frame is in another one."""

    name: str

    def read(self) -> Pose | None:
        """Return the newest pose that came since the last call; None: none came."""

    def close(self) -> None:
        """Leave the network; allowed twice."""


def open_poses(where: str, clock: Clock) -> PoseReader:
    """Open the poses that a person names: ``topic:/PSM1/measured_cp``, or ``HOST:PORT/DEVICE``.

    Raises `ConfigError` if the words name nothing, `NotConnectedError` if nobody answers.
    """
    if where.startswith(TOPIC):
        return RosPoses(where.removeprefix(TOPIC), clock)
    found = _SERVER.fullmatch(where)
    if found is None or not 0 < int(found["port"]) < 65536:
        raise ConfigError(f"poses: {where} is no place; name {TOPIC}/PSM1/measured_cp of ROS 2, or HOST:PORT/DEVICE")
    return IgtlPoses(found["host"], int(found["port"]), found["device"], clock)


class IgtlPoses(IgtlMessages):
    """The TRANSFORM messages of one device."""

    driver = "poses"
    content = "TRANSFORM"
    peer = "server of the poses"

    def __init__(self, host: str, port: int, device: str, clock: Clock) -> None:
        super().__init__(connect_plus(host, port, within_s=CONNECT_S, driver=self.driver), clock, device=device)
        self.name = f"{device} of {host}:{port}"
        self._first: Pose | None = None
        try:
            self._await_first()
        except BaseException:
            self.close()
            raise

    def _await_first(self) -> None:
        """Wait for the first pose, so that a wrong name is refused before anything turns."""
        for _ in polls(self._clock, within_s=CONNECT_S, every_s=_POLL_S):
            self._first = self.read()
            if self._first is not None:
                return
        raise DeviceTimeoutError(
            f"poses: no {self.content} {self._device!r} came within {CONNECT_S:g} s{self.other_devices}; correct the "
            "name, or let the server send it"
        )

    def read(self) -> Pose | None:
        """As of `PoseReader`; a transform whose status is not OK, or that is NaN, is not valid."""
        newest = self._first
        self._first = None
        more = True
        while more:
            came, more = self.take()
            newest = _pose(came[-1]) if came else newest
        return newest


def _pose(message: igtl.Message) -> Pose:
    """Return the pose of a TRANSFORM."""
    assert isinstance(message.content, igtl.Transform)  # noqa: S101  by the kind in its header
    valid = message.metadata.get("TransformStatus", "OK") == "OK"
    return Pose(matrix=message.content.matrix if valid else None, stamp_s=message.time_s or None)


class RosPoses:
    """The poses on a topic of `POSE_KINDS`."""

    def __init__(self, topic: str, clock: Clock) -> None:
        self.name = f"topic {topic}"
        self._newest: Any = None
        self._node = RosNode("markerseek_poses")
        try:
            self._subscribe(topic, clock)
        except BaseException:
            self._node.close()
            raise

    def _subscribe(self, topic: str, clock: Clock) -> None:
        require_found(
            self._node,
            clock,
            lambda: self._node.kind_of(topic) is not None,
            missing=f"poses: nobody publishes {topic}",
            cure="start the robot's node, and compare ros2 topic list",
            connect_s=CONNECT_S,
        )
        kind = self._node.kind_of(topic)
        if kind not in POSE_KINDS:
            raise ConfigError(f"poses: {topic} carries {kind}, one of {', '.join(POSE_KINDS)} is read")
        self._node.subscribe(topic, str(kind), self._on_message)

    def _on_message(self, message: Any) -> None:
        self._newest = message

    def read(self) -> Pose | None:
        """As of `PoseReader`."""
        self._node.drain(_MAX_WAITING)
        message = self._newest
        self._newest = None
        if message is None:
            return None
        stamp = message.header.stamp
        return Pose(matrix=pose_matrix(message), stamp_s=stamp.sec + 1e-9 * stamp.nanosec or None)

    def close(self) -> None:
        """Leave the network; allowed twice."""
        self._node.close()


def pose_matrix(message: Any) -> Float64[np.ndarray, "4 4"] | None:
    """Return the matrix of a PoseStamped or a TransformStamped, in millimetres; None if it holds no pose."""
    from scipy.spatial.transform import Rotation

    if hasattr(message, "pose"):
        place = message.pose.position
        turn = message.pose.orientation
    else:
        place = message.transform.translation
        turn = message.transform.rotation
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w])
    place_mm = 1e3 * np.array([place.x, place.y, place.z])
    # Without this check a quaternion of any length would be taken for a rotation.
    if not (np.isfinite(place_mm).all() and abs(quaternion @ quaternion - 1) < 1e-3):
        return None
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = place_mm
    return matrix
