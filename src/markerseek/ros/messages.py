"""ROS 2 messages of a rig and of one acquisition, made and read; which commands are accepted."""

from __future__ import annotations

import array
import importlib
import math
from functools import cache
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np

from markerseek.core import Int16, MissingExtraError, PaImage, ScanGeometry, UInt8, is_finite, needs_package
from markerseek.geometry import RigidTransform

JOINT = "trus_roll"
"""Name of the joint."""

HOME = "trus_home"
_PROBE = "trus_probe"
IMAGE = "trus_image"
"""Frames: the probe at 0 degrees, the probe, and the images (x along columns, y along rows, from the first pixel)."""

CAMERA = "davinci_camera_optical"
SIMULATED_CAMERA = "simulated_davinci_camera_optical"
"""Frame of the da Vinci camera (z along its view) with a real and with a simulated registration. The name states this,
because a transform has no field for it."""

_TRANSDUCER_QUATERNION = (0.5, 0.5, 0.5, 0.5)
"""Rotation from image to probe as x, y, z, w: columns along y, rows along z."""


@cache
def kind(name: str) -> Any:
    """Return the class of a message or service, such as ``std_msgs/msg/String``.

    `MissingExtraError` if it is not installed.
    """
    package, folder, member = name.split("/")
    with needs_package(package, extra="ros2", purpose=f"a message {name}"):
        return getattr(importlib.import_module(f"{package}.{folder}"), member)


@cache
def is_installed(name: str) -> bool:
    """Return whether the package of a message is installed."""
    try:
        kind(name)
    except (MissingExtraError, AttributeError):
        return False
    return True


def made(what: str, /, **fields: Any) -> Any:
    """Return a message of a kind, with these fields."""
    return kind(what)(**{key: _native(value) for key, value in fields.items()})


def _native(value: object) -> object:
    # rclpy converts a NumPy array pixel by pixel, 100 ms for an image; an `array.array` takes almost no time.
    return array.array(value.dtype.char, value.tobytes()) if isinstance(value, np.ndarray) else value


def time_ns(time_s: float) -> int:
    """Return a time in whole nanoseconds."""
    # A double holds seconds since 1970 to about 0.2 µs, which is enough for acquisitions.
    return round(time_s * 1e9)


def header(*, time_s: float, frame: str = "") -> Any:
    """Return the header of a message; the frame is empty if the message has no coordinates."""
    sec, nanosec = divmod(time_ns(time_s), 1_000_000_000)
    stamp = made("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def joint_state(*, time_s: float, angle_deg: float, joint: str = JOINT) -> Any:
    """Return the angle of the probe, in radians, as that of a joint."""
    nothing = np.empty(0, np.float64)
    return made(
        "sensor_msgs/msg/JointState",
        header=header(time_s=time_s, frame=HOME),
        name=[joint],
        position=np.array([math.radians(angle_deg)]),
        velocity=nothing,
        effort=nothing,
    )


def turned_probe(*, time_s: float, angle_deg: float) -> Any:
    """Return the transform of the probe in its home frame, as a geometry_msgs/TransformStamped."""
    # Rotation about y by θ as the quaternion (0, sin θ/2, 0, cos θ/2), in ROS's order x, y, z, w.
    half = math.radians(angle_deg) / 2
    quaternion = (0.0, math.sin(half), 0.0, math.cos(half))
    return _transform(time_s, (HOME, _PROBE), quaternion=quaternion, place_m=(0.0, 0.0, 0.0))


def mounted(geometry: ScanGeometry, *, time_s: float, face_radius_m: float) -> Any:
    """Return the transform of an image in the frame of the probe, as a geometry_msgs/TransformStamped."""
    place_m = (0.0, geometry.first_lateral_m, face_radius_m + geometry.first_depth_m)
    return _transform(time_s, (_PROBE, IMAGE), quaternion=_TRANSDUCER_QUATERNION, place_m=place_m)


def registered(davinci_to_trus: RigidTransform | None, *, time_s: float, simulated: bool) -> Any:
    """Return the camera of the da Vinci system in the home frame of the probe, as a geometry_msgs/TransformStamped.

    ``davinci_to_trus``: None is sent as NaN, which no program can mistake for a position, and which tf2 refuses.
    """
    frames = HOME, SIMULATED_CAMERA if simulated else CAMERA
    if davinci_to_trus is None:
        return _transform(time_s, frames, quaternion=(math.nan,) * 4, place_m=(math.nan,) * 3)
    from scipy.spatial.transform import Rotation

    x, y, z, w = map(float, Rotation.from_matrix(davinci_to_trus.rotation).as_quat())
    place_x_m, place_y_m, place_z_m = map(float, davinci_to_trus.translation_m)
    return _transform(time_s, frames, quaternion=(x, y, z, w), place_m=(place_x_m, place_y_m, place_z_m))


def text(content: Any) -> Any:
    """Return a value as JSON in a std_msgs/String; numbers that are not finite become null."""
    return made("std_msgs/msg/String", data=msgspec.json.encode(content).decode("utf-8"))


def number(value: float) -> Any:
    """Return a std_msgs/Float64."""
    return made("std_msgs/msg/Float64", data=float(value))


def channels(samples: Int16[np.ndarray, "channels samples"], *, time_s: float) -> Any:
    """Return the image message of channel data: a row per channel, 16SC1, ADC counts."""
    return _image(samples.astype("<i2", copy=False), encoding="16SC1", time_s=time_s, frame=_PROBE)


def empty() -> Any:
    """Return a std_msgs/Empty."""
    return made("std_msgs/msg/Empty")


class AcquireRequest(msgspec.Struct, frozen=True, kw_only=True):
    """Request to an acquisition node.

    ``id`` names the request. ``pulses``: 0 takes a dark frame, -1 ends the acquisition. ``stamp_ns``: time at which the
    request was sent, on the clock of ROS.
    """

    id: str
    pulses: int
    angle_rad: float
    stamp_ns: int


class Acquired(msgspec.Struct, frozen=True, kw_only=True):
    """Answer of an acquisition node: first ``fired``, then ``frame``, or ``error``.

    ``stamp_ns`` of a frame is the stamp of its channel data; ``simulated`` says that there was no light; ``energy`` is
    that of `FrameHeader`.
    """

    id: str
    step: Literal["fired", "frame", "error"]
    pulses: int = 0
    sequence: int = 0
    sampling_hz: float = 0.0
    stamp_ns: int = 0
    error: str = ""
    simulated: bool = False
    energy: float | None = None


class AcquisitionState(msgspec.Struct, frozen=True, kw_only=True):
    """State of an acquisition node."""

    simulated: bool


class OperatingState(msgspec.Struct, frozen=True, kw_only=True):
    """State of a stage node: the fields of crtk_msgs/OperatingState, and further ones.

    ``angle_deg`` is the angle at rest as the stage reported it: in radians it would be rounded, and a search could then
    decide otherwise.
    """

    state: str
    is_homed: bool
    is_busy: bool
    stamp_ns: int
    angle_deg: float | None = None
    simulated: bool = False
    refused: str = ""
    refused_ns: int = 0
    fault: str = ""


_Value = TypeVar("_Value", bound=msgspec.Struct)


def decoded(data: str, kind: type[_Value]) -> _Value | None:
    """Return the value of this kind in the text of a std_msgs/String; None if the text is not one."""
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None


FRAMES_KIND = "tf2_msgs/msg/TFMessage"


def frames_kind() -> str:
    """Return the name of the message with transforms: that of tf2 if it is installed."""
    return FRAMES_KIND if is_installed(FRAMES_KIND) else "geometry_msgs/msg/TransformStamped"


CRTK_STATE = "crtk_msgs/msg/OperatingState"
"""State of a stage node of another program, which our driver reads."""


def state_of(message: Any) -> OperatingState | None:
    """Return the state in a message; None if the message has none."""
    if hasattr(message, "data"):
        return decoded(message.data, OperatingState)
    return OperatingState(
        state=message.state, is_homed=message.is_homed, is_busy=message.is_busy, stamp_ns=stamp_ns(message)
    )


def channel_data_of(message: Any) -> Int16[np.ndarray, "channels samples"] | None:
    """Return the channel data of an image message; None if it is not a 16SC1 image of the size that it states."""
    rows = message.height
    columns = message.width
    data = bytes(message.data)
    right = message.encoding == "16SC1" and rows > 0 and columns > 0 and message.step == 2 * columns
    if not right or len(data) != 2 * rows * columns:
        return None
    order = ">i2" if message.is_bigendian else "<i2"
    return np.frombuffer(data, dtype=order).reshape(rows, columns).astype(np.int16, copy=False)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message with a header, in nanoseconds."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def envelope_image(image: PaImage, *, time_s: float) -> Any:
    """Return the image message of the envelope, 32FC1, in ADC counts."""
    return _image(image.envelope.astype("<f4"), encoding="32FC1", time_s=time_s)


def picture(levels: UInt8[np.ndarray, "rows columns"], *, time_s: float) -> Any:
    """Return the image message of grey levels, mono8."""
    return _image(levels, encoding="mono8", time_s=time_s)


def _image(pixels: np.ndarray[Any, Any], *, encoding: str, time_s: float, frame: str = IMAGE) -> Any:
    rows, columns = pixels.shape
    return made(
        "sensor_msgs/msg/Image",
        header=header(time_s=time_s, frame=frame),
        height=rows,
        width=columns,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.itemsize * columns,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def _transform(
    time_s: float,
    frames: tuple[str, str],
    *,
    quaternion: tuple[float, float, float, float],
    place_m: tuple[float, float, float],
) -> Any:
    parent, child = frames
    place = made("geometry_msgs/msg/Vector3", **dict(zip("xyz", place_m, strict=True)))
    rotation = made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", quaternion, strict=True)))
    return made(
        "geometry_msgs/msg/TransformStamped",
        header=header(time_s=time_s, frame=parent),
        child_frame_id=child,
        transform=made("geometry_msgs/msg/Transform", translation=place, rotation=rotation),
    )


MAX_AGE_S = 0.3
"""Oldest command that is carried out, in seconds: one that waited on the network is not what is wanted now."""

MAX_AHEAD_S = 0.05
"""Most by which a stamp may lie in the future, in seconds: clocks of two computers differ by some milliseconds."""


class StampedCommands:
    """Accepts commands whose stamp is fresh and later than the last."""

    def __init__(self) -> None:
        self._last_ns = 0

    def refusal(self, stamp_ns: int, *, now_s: float) -> str | None:
        """Return why a command is dropped; None if it is accepted.

        ``stamp_ns``: its stamp in nanoseconds; 0 is none.
        """
        age_s = now_s - stamp_ns * 1e-9
        if self._last_ns * 1e-9 > now_s + MAX_AHEAD_S:
            # The clock was set back: what came before it says nothing of what is new.
            self._last_ns = 0
        if stamp_ns == 0:
            return "it carries no stamp; set header.stamp to the time at which it is sent"
        if age_s > MAX_AGE_S:
            return f"it is {age_s:.2f} s old, at most {MAX_AGE_S} s are accepted"
        if not age_s >= -MAX_AHEAD_S:
            return f"it is stamped {-age_s:.2f} s ahead; compare the computers' clocks"
        if stamp_ns <= self._last_ns:
            return "its stamp is not later than that of the command before; it is a repetition"
        self._last_ns = stamp_ns
        return None


def joint_angle_deg(message: Any, *, joint: str = JOINT) -> float | None:
    """Return the angle of a joint in degrees; None if the message does not hold it, or no finite number.

    ``message``: a sensor_msgs/JointState; of a single joint the name may be left out.
    """
    names = list(message.name) or [joint]
    if names.count(joint) != 1 or len(message.position) != len(names):
        return None
    position_rad = message.position[names.index(joint)]
    return degrees(position_rad) if is_finite(position_rad) else None


def degrees(angle_rad: float) -> float:
    """Return an angle in degrees, to 1e-9 degrees: the end of a range stays in the range on its way over radians."""
    return round(math.degrees(angle_rad), 9)
