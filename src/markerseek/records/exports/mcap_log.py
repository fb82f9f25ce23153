"""Writes a bank as an MCAP log with the ROS 2 topics of a running rig, by rosbags, without ROS.

===========================  ==========================  ==========================================================
``/pa_search/bank``          std_msgs/String, latched    JSON, once: what is known of the bank, the pixels and the times
``/TRUS/measured_js``        sensor_msgs/JointState      joint ``trus_roll`` in radians
``/tf``                      tf2_msgs/TFMessage          ``trus_home`` to ``trus_probe`` (turned about y), and to
                                                         ``trus_image`` where the face radius is known; metres
``/TRUS/pa/image``           sensor_msgs/Image, mono8    to be looked at, in decibels
``/TRUS/pa/envelope``        sensor_msgs/Image, 32FC1    the same to be calculated with, in ADC counts
``/pa_search/sample``        std_msgs/String             JSON for programs, as of a running node: `messages.sample`
``/pa_search/intensity``     std_msgs/Float64            the intensity once more, for plots, which want a number
===========================  ==========================  ==========================================================

Foxglove shows 32FC1 from 0 to 1 and mono16 from 0 to 10000: counts would be white there, or black. A shade g of
``/TRUS/pa/image`` stands for B 10^((g / 255 - 1) R / 20) counts, to half a step of R / 255 dB; B and R are
``picture_white`` and ``picture_range_db`` of ``/pa_search/bank``. 0 is that and anything less, 255 that and more.

The metadata of the file (``ros2 bag info``) hold the JSON of ``/pa_search/bank``, too, under ``markerseek``; a player
does not publish metadata, so the topic is needed as well.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from markerseek.core import ConfigError, PaImage, needs_package
from markerseek.files import new_file
from markerseek.records.exports.series import Series, one_for_each
from markerseek.ros import messages
from markerseek.ros.topics import BANK, ENVELOPE, FRAMES, INTENSITY, MEASURED_JS, PICTURE, SAMPLE

if TYPE_CHECKING:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys.store import Typestore

METADATA = "markerseek"
"""Key of the bank's facts in the metadata of the log."""


def write_mcap(path: Path, images: Iterator[PaImage] | None, *, series: Series, brightest: float | None = None) -> None:
    """Write a bank as one MCAP file, in the order of time.

    ``path``: file to be written; it must not exist. ``images``: image of each acquisition, in the order of the series,
    taken one at a time. ``brightest``: envelope in ADC counts that pictures show as white; for images only.
    """
    if images is not None and not (brightest is not None and 0 < brightest < math.inf):
        raise ConfigError(f"brightest is {brightest} ADC counts, it must be positive and finite")
    with needs_package("rosbags", extra="records", purpose="an export as MCAP"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    count = len(series.angles_deg)
    # rosbags writes a folder with the log and a description of it; the log alone is complete.
    with new_file(path) as part, tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as writer:
            each = repeat(None, count) if images is None else one_for_each(path, images, count)
            _Log(writer, get_typestore(Stores.ROS2_JAZZY)).write(series, each, brightest=brightest)
        # In the same folder as the target, so that the rename stays on one disk.
        (bag / "bag.mcap").rename(part)


class _Log:
    """Messages of a series, on their topics."""

    def __init__(self, writer: Writer, store: Typestore) -> None:
        self._writer, self._store = writer, store
        self._connections: dict[str, Any] = {}

    def write(self, series: Series, images: Iterable[PaImage | None], *, brightest: float | None) -> None:
        kinds = self._store.types
        radius_m = series.facts.face_radius_m
        count = len(series.angles_deg)
        intensities = series.intensities or repeat(math.nan, count)
        for number, (angle_deg, time_s, intensity, image) in enumerate(
            zip(series.angles_deg, series.times_s, intensities, images, strict=True)
        ):
            # With the first acquisition, because the log begins at its time.
            if not self._connections:
                self._put_bank_facts(series, image, brightest=brightest)
            at_ns = messages.time_ns(time_s)
            self._put(MEASURED_JS, messages.joint_state(kinds, time_s=time_s, angle_deg=angle_deg), at_ns)
            placed = {} if image is None else {messages.IMAGE: image.geometry}
            turned = messages.transforms(
                kinds, time_s=time_s, angle_deg=angle_deg, images=placed, face_radius_m=radius_m
            )
            self._put(FRAMES, kinds["tf2_msgs/msg/TFMessage"](transforms=turned), at_ns)
            if image is not None and brightest is not None:
                self._put(PICTURE, messages.picture(kinds, image, time_s=time_s, brightest=brightest), at_ns)
                self._put(ENVELOPE, messages.envelope(kinds, image, time_s=time_s), at_ns)
            sample = messages.sample(
                index=number + 1,
                # What a bank is played as.
                role="search",
                angle_deg=angle_deg,
                intensity=intensity,
                time_s=time_s,
                pulses=series.pulses[number] if series.pulses else None,
                images=placed,
            )
            self._put_json(SAMPLE, sample, at_ns)
            # This topic is for plots, which want a number.
            if math.isfinite(intensity):
                self._put(INTENSITY, kinds["std_msgs/msg/Float64"](data=float(intensity)), at_ns)

    def _put_bank_facts(self, series: Series, image: PaImage | None, *, brightest: float | None) -> None:
        known: dict[str, Any] = {"angles": len(series.angles_deg), **series.known}
        if image is not None:
            known |= image.geometry.grid | {"picture_white": brightest, "picture_range_db": messages.RANGE_DB}
        self._put_json(BANK, known, messages.time_ns(series.times_s[0]))
        self._writer.set_custom_data(METADATA, msgspec.json.encode(known).decode("utf-8"))

    def _put_json(self, topic: str, content: dict[str, Any], at_ns: int) -> None:
        text = msgspec.json.encode(content).decode("utf-8")
        self._put(topic, self._store.types["std_msgs/msg/String"](data=text), at_ns)

    def _put(self, topic: str, message: Any, at_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=self._store, offered_qos_profiles=[_latched()] if topic == BANK else ()
            )
        self._writer.write(self._connections[topic], at_ns, self._store.serialize_cdr(message, kind))


def _latched() -> Any:
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    # The infinite duration of ROS 2 (2^63 - 1 ns), in seconds and nanoseconds.
    for_ever = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=for_ever,
        lifespan=for_ever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=for_ever,
        avoid_ros_namespace_conventions=False,
    )
