"""ROS 2 messages of one acquisition; the message classes are passed in by the writer of the log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from markerseek.core import Float32, PaImage, UInt8

Kinds: TypeAlias = Mapping[str, Any]
"""Classes of messages by name."""

JOINT = "trus_roll"
"""Name of the joint."""

HOME, PROBE, IMAGE = "trus_home", "trus_probe", "trus_image"
"""Frames: the probe at 0 degrees, the probe, and the image (x along columns, y along rows, from the first pixel)."""

RANGE_DB = 40.0
"""Dynamic range from white to black, in dB."""

_TRANSDUCER_QUATERNION = (0.5, 0.5, 0.5, 0.5)
"""The rotation of `markerseek.records.exports.frames.TRANSDUCER_AXES` as x, y, z, w."""


def time_ns(time_s: float) -> int:
    """A time in whole nanoseconds."""
    # A double holds seconds since 1970 to about 0.2 µs, which is enough for acquisitions.
    return round(time_s * 1e9)


def header(kinds: Kinds, *, time_s: float, frame: str = "") -> Any:
    """Header of a message; an empty frame where the message has no coordinates."""
    sec, nanosec = divmod(time_ns(time_s), 1_000_000_000)
    stamp = kinds["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def joint_state(kinds: Kinds, *, time_s: float, angle_deg: float) -> Any:
    """Angle of the probe, in radians."""
    nothing = np.empty(0, np.float64)
    return kinds["sensor_msgs/msg/JointState"](
        header=header(kinds, time_s=time_s),
        name=[JOINT],
        position=np.array([math.radians(angle_deg)]),
        velocity=nothing,
        effort=nothing,
    )


def transforms(
    kinds: Kinds, *, time_s: float, angle_deg: float, image: PaImage | None, face_radius_m: float | None
) -> Any:
    """Transforms of the probe in its home frame, and of the image in the probe where the face radius is known."""
    # Rotation about y by θ as the quaternion (0, sin θ/2, 0, cos θ/2), in ROS's order x, y, z, w.
    half = math.radians(angle_deg) / 2
    turned = _transform(
        kinds, time_s, (HOME, PROBE), quaternion=(0.0, math.sin(half), 0.0, math.cos(half)), place_m=(0.0, 0.0, 0.0)
    )
    if image is None or face_radius_m is None:
        return kinds["tf2_msgs/msg/TFMessage"](transforms=[turned])
    place_m = (0.0, float(image.lateral_m[0]), face_radius_m + float(image.depth_m[0]))
    mounted = _transform(kinds, time_s, (PROBE, IMAGE), quaternion=_TRANSDUCER_QUATERNION, place_m=place_m)
    return kinds["tf2_msgs/msg/TFMessage"](transforms=[turned, mounted])


def envelope(kinds: Kinds, image: PaImage, *, time_s: float) -> Any:
    """Image message of the envelope, 32FC1, in ADC counts."""
    return _image(kinds, image.envelope.astype("<f4"), encoding="32FC1", time_s=time_s)


def picture(kinds: Kinds, image: PaImage, *, time_s: float, brightest: float) -> Any:
    """Image message of the envelope in decibels, mono8: `RANGE_DB` below the brightest value is black."""
    return _image(kinds, grey(image.envelope, brightest=brightest), encoding="mono8", time_s=time_s)


def grey(values: Float32[np.ndarray, "rows columns"], *, brightest: float) -> UInt8[np.ndarray, "rows columns"]:
    """Envelope in ADC counts as shades from 0 (`RANGE_DB` and more below) to 255 (the brightest and above)."""
    # The lower end is clipped before the logarithm, which has none of zero.
    share = np.clip(values / brightest, 10 ** (-RANGE_DB / 20), 1.0)
    return np.rint(255 * (1 + 20 * np.log10(share) / RANGE_DB)).astype(np.uint8)


def _image(kinds: Kinds, pixels: np.ndarray[Any, Any], *, encoding: str, time_s: float) -> Any:
    rows, columns = pixels.shape
    return kinds["sensor_msgs/msg/Image"](
        header=header(kinds, time_s=time_s, frame=IMAGE),
        height=rows,
        width=columns,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.itemsize * columns,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def _transform(
    kinds: Kinds,
    time_s: float,
    frames: tuple[str, str],
    *,
    quaternion: tuple[float, float, float, float],
    place_m: tuple[float, float, float],
) -> Any:
    parent, child = frames
    place = kinds["geometry_msgs/msg/Vector3"](**dict(zip("xyz", place_m, strict=True)))
    rotation = kinds["geometry_msgs/msg/Quaternion"](**dict(zip("xyzw", quaternion, strict=True)))
    return kinds["geometry_msgs/msg/TransformStamped"](
        header=header(kinds, time_s=time_s, frame=parent),
        child_frame_id=child,
        transform=kinds["geometry_msgs/msg/Transform"](translation=place, rotation=rotation),
    )
