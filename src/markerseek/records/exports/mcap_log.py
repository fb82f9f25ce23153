"""A bank as MCAP: the topics that a running rig has in ROS 2, written by rosbags without ROS.

``/TRUS/pa/image`` (sensor_msgs/Image, 32FC1: the envelope), ``/TRUS/measured_js`` (sensor_msgs/JointState: joint
``trus_roll`` in radians) and ``/pa_search/intensity`` (std_msgs/Float64).
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from markerseek.core import MissingExtraError, PaImage, RecordError
from markerseek.records.exports._new_file import require_new

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys.store import Typestore

IMAGE, ANGLE, INTENSITY = "/TRUS/pa/image", "/TRUS/measured_js", "/pa_search/intensity"
"""Topics."""

JOINT, FRAME = "trus_roll", "trus_image"
"""Name of the joint, and of the frame in which images lie."""

_NS_PER_S = 1_000_000_000


def write_mcap(
    path: Path, images: Iterator[PaImage] | None, *, angles_deg: Sequence[float], intensities: Sequence[float]
) -> None:
    """Write a bank as one MCAP file, one second from each acquisition to the next.

    Parameters
    ----------
    path
        File to be written; it must not exist.
    images
        Image of each angle, taken one at a time; None where there are intensities only.
    angles_deg
        Angle of the probe at each, in degrees.
    intensities
        Intensity at each, NaN where it is not known; may be empty.

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.
    RecordError
        If the file cannot be written.
    """
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as problem:
        raise MissingExtraError(package="rosbags", extra="records", purpose="an export as MCAP") from problem
    require_new(path)
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # rosbags writes a folder with the log and a description of it; the log alone is complete.
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            bag = Path(folder) / "bag"
            with Writer(bag, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as writer:
                _write_all(writer, store, images, angles_deg, intensities)
            (bag / "bag.mcap").rename(path)
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror or problem}; name another place") from (
            problem
        )


def _write_all(
    writer: Writer,
    store: Typestore,
    images: Iterator[PaImage] | None,
    angles_deg: Sequence[float],
    intensities: Sequence[float],
) -> None:
    kinds = store.types
    topics = [(ANGLE, "sensor_msgs/msg/JointState")]
    topics += [(IMAGE, "sensor_msgs/msg/Image")] if images is not None else []
    topics += [(INTENSITY, "std_msgs/msg/Float64")] if len(intensities) else []
    connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics}

    def put(topic: str, message: object, second: int) -> None:
        connection = connections[topic]
        writer.write(connection, second * _NS_PER_S, store.serialize_cdr(message, connection.msgtype))

    for number, angle_deg in enumerate(angles_deg):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=number, nanosec=0)
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=FRAME)
        nothing = np.empty(0, np.float64)
        position = np.array([math.radians(angle_deg)])
        joint = kinds["sensor_msgs/msg/JointState"](
            header=header, name=[JOINT], position=position, velocity=nothing, effort=nothing
        )
        put(ANGLE, joint, number)
        if images is not None:
            put(IMAGE, _image(store, header, next(images)), number)
        if len(intensities):
            put(INTENSITY, kinds["std_msgs/msg/Float64"](data=float(intensities[number])), number)


def _image(store: Typestore, header: Any, image: PaImage) -> object:
    rows, columns = image.envelope.shape
    return store.types["sensor_msgs/msg/Image"](
        header=header,
        height=rows,
        width=columns,
        encoding="32FC1",
        is_bigendian=0,
        step=4 * columns,
        data=np.frombuffer(image.envelope.astype("<f4").tobytes(), np.uint8),
    )
