"""Settings of a stage, a laser and a receiver behind ROS 2 topics: the keys of a rig file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from markerseek.core import ConfigError, require_range
from markerseek.drivers._light import LaserKeys
from markerseek.drivers._receivers import require_noise_ratio
from markerseek.ros import topics


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2StageSettings:
    """A stage node that takes an angle on one topic and returns the angle reached on another."""

    driver: Literal["ros2"] = "ros2"
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
    connect_s: float = 10.0
    """Longest time until its node is found."""
    timeout_s: float = 60.0
    """Longest duration of a move."""
    arrival_deg: float = 0.05
    """Largest distance from the target at which an angle counts as reached."""
    age_s: float | None = 1.0
    """Greatest age of an angle; None for nodes that publish it after a move only."""

    def __post_init__(self) -> None:
        for name, high in (("connect_s", 600), ("timeout_s", 600)):
            require_range(f"stage: {name}", getattr(self, name), low=0, high=high, unit="s", open_low=True)
        require_range("stage: arrival_deg", self.arrival_deg, low=0.001, high=0.1, unit="deg")
        if self.age_s is not None:
            require_range("stage: age_s", self.age_s, low=0.05, high=60, unit="s")
        if self.message == "joint_state" and self.unit != "rad":
            raise ConfigError("stage: unit is deg, and a joint_state is in radians; use message = 'float64', or 'rad'")
        if self.message == "float64" and self.state_topic is not None:
            raise ConfigError("stage: message is float64, and such nodes publish no state; add state_topic = 'none'")


@dataclass(frozen=True, slots=True, kw_only=True)
class RosLaser(LaserKeys):
    """The laser of an acquisition node, which fires it under its own guard."""

    driver: Literal["ros2"] = "ros2"
    """Driver of the laser; the receiver's must be the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RosReceiver:
    """The receiver of an acquisition node."""

    driver: Literal["ros2"] = "ros2"
    """Driver of the data acquisition."""
    request_topic: str = topics.ACQUIRE
    answer_topic: str = topics.ACQUIRED
    frame_topic: str = topics.CHANNELS
    """``request_topic``, ``answer_topic`` and ``frame_topic``: where an acquisition is asked for, where it is answered,
    and where its channel data come."""
    sampling_hz: float = 40e6
    connect_s: float = 10.0
    """Longest time until the node is found."""
    timeout_s: float = 60.0
    """Longest time from the request to the frame."""
    noise_ratio: float = 2.0

    def __post_init__(self) -> None:
        require_range("receiver: sampling_hz", self.sampling_hz, low=0, high=1e9, unit="Hz", open_low=True)
        for name in ("connect_s", "timeout_s"):
            require_range(f"receiver: {name}", getattr(self, name), low=0, high=600, unit="s", open_low=True)
        require_noise_ratio(self.noise_ratio)
