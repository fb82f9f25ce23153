"""Poses that a robot or a tracker reports: of a ROS 2 topic, or a TRANSFORM of OpenIGTLink."""

from __future__ import annotations

import re
from typing import Any, Protocol

import numpy as np

from markerseek.core import Clock, ConfigError, Float64
from markerseek.drivers.plus import IgtlMessages, connect_plus
from markerseek.drivers.ros2 import require_found
from markerseek.drivers.stereo_images import TOPIC
from markerseek.ros import RosNode
from markerseek.wire import igtl

CONNECT_S = 10.0
"""Longest wait for a node or a server, in seconds."""

POSE_KINDS = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped")
"""Messages that are read."""

_MAX_WAITING = 100
"""Most messages that are read at once."""

_SERVER = re.compile(r"(?P<host>[^/\s]+):(?P<port>\d{1,5})/(?P<device>\S+)")


class PoseReader(Protocol):
    """Reports where a frame is in another one."""

    name: str

    def read(self) -> tuple[bool, Float64[np.ndarray, "4 4"] | None]:
        """Whether anything came since the last call, and the newest pose, in millimetres; None: it is not valid."""

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

    def read(self) -> tuple[bool, Float64[np.ndarray, "4 4"] | None]:
        """As of `PoseReader`; a transform whose status is not OK, or that is NaN, is not valid."""
        came, _ = self.take()
        if not came:
            return False, None
        newest = came[-1]
        assert isinstance(newest.content, igtl.Transform)  # noqa: S101  by the kind in its header
        valid = newest.metadata.get("TransformStatus", "OK") == "OK"
        return True, newest.content.matrix if valid else None


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

    def read(self) -> tuple[bool, Float64[np.ndarray, "4 4"] | None]:
        """As of `PoseReader`."""
        self._node.drain(_MAX_WAITING)
        message = self._newest
        self._newest = None
        return (False, None) if message is None else (True, pose_matrix(message))

    def close(self) -> None:
        """Leave the network; allowed twice."""
        self._node.close()


def pose_matrix(message: Any) -> Float64[np.ndarray, "4 4"] | None:
    """Matrix of a PoseStamped or a TransformStamped, in millimetres; None if it holds no pose."""
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
