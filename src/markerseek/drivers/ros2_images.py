"""Image pairs from two ROS 2 topics."""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np

from markerseek.core import AcquisitionError, ConfigError, UInt8
from markerseek.drivers._pair_source import Pairing, PairSource
from markerseek.drivers._ros2_waiting import require_found
from markerseek.drivers.clock import SystemClock
from markerseek.geometry import Camera
from markerseek.ros import RosNode, messages
from markerseek.vision import brightness, decoded_image

NEAR_S = 0.01
"""Largest difference between the stamps of two images that are a pair, in seconds."""

_SPIN_S = 0.1
"""Longest time until the end of the source is noticed, in seconds."""

_IMAGE = "sensor_msgs/msg/Image"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"

_CHANNELS = {
    "mono8": 1,
    "8UC1": 1,
    "bgr8": 3,
    "rgb8": 3,
    "8UC3": 3,
    "bgra8": 4,
    "rgba8": 4,
    "8UC4": 4,
}
"""Channels of the encodings that are read."""


class RosImages(PairSource):
    """Image pairs from two topics of sensor_msgs/Image, or of CompressedImage where they end with ``/compressed``.

    Publishers of every reliability are accepted. Images are a pair if each is the nearest to the other by the stamps in
    their headers, and these differ by at most `NEAR_S`.

    ``connect_s``: longest time until both topics have a publisher. Raises `NotConnectedError` if they have none.
    """

    def __init__(self, topics: tuple[str, str], cameras: tuple[Camera, Camera], *, connect_s: float = 10.0) -> None:
        if topics[0] == topics[1]:
            raise ConfigError(f"{topics[0]}: it is given for both cameras; give each camera its own topic")
        super().__init__(
            f"topics {topics[0]} (left) and {topics[1]} (right)",
            topics,
            cameras,
            pairing=Pairing(near_s=NEAR_S),
            silent_cure="start its node again, and compare ros2 topic hz",
            cure=(
                f"images of a pair carry stamps that differ by at most {1e3 * NEAR_S:g} ms; have one driver stamp "
                "both, or compare the clocks of their computers"
            ),
        )
        self._node = RosNode("markerseek_images")
        try:
            self._subscribe(connect_s)
        except BaseException:
            self._node.close()
            raise
        now_s = time.monotonic()
        self._last_s = [now_s, now_s]
        self._start(self._spin)

    def _subscribe(self, connect_s: float) -> None:
        node = self._node
        kinds = [_kind(topic) for topic in self._sources]
        for side, (topic, kind) in enumerate(zip(self._sources, kinds, strict=True)):
            node.subscribe(topic, kind, partial(self._on_image, side))
        require_found(
            node,
            SystemClock(),
            lambda: all(node.kind_of(topic) is not None for topic in self._sources),
            missing=f"images: {self._sources[0]} and {self._sources[1]} do not both have a publisher",
            cure="start the node of the cameras, and compare ros2 topic list",
            connect_s=connect_s,
        )
        for topic, kind in zip(self._sources, kinds, strict=True):
            if (found := node.kind_of(topic)) not in (kind, None):
                raise ConfigError(f"{topic}: it carries {found}, and {kind} is expected; name the topic of the images")

    def _spin(self) -> None:
        while True:
            with self._in_library(0):
                self._node.spin(_SPIN_S)

    def close(self) -> None:
        """End the thread, and leave the network; allowed twice."""
        super().close()
        self._node.close()

    def _on_image(self, side: int, message: Any) -> None:
        topic = self._sources[side]
        at_s = time.monotonic()
        stamp_ns = messages.stamp_ns(message)
        if stamp_ns == 0:
            raise AcquisitionError(f"{topic}: an image carries no stamp; set header.stamp to the time of the image")
        pixels = _decoded(message, topic) if _kind(topic) == _COMPRESSED else _pixels(message, topic)
        if pixels is not None:
            self._take(side, pixels, time_s=1e-9 * stamp_ns, at_s=at_s)


def _kind(topic: str) -> str:
    return _COMPRESSED if topic.endswith("/compressed") else _IMAGE


def _decoded(message: Any, topic: str) -> UInt8[np.ndarray, "rows columns"] | None:
    """Return the brightness of a CompressedImage; None if it is damaged."""
    try:
        return decoded_image(bytes(message.data))
    except ConfigError as problem:
        raise AcquisitionError(f"{topic}: {problem}") from problem


def _pixels(message: Any, topic: str) -> UInt8[np.ndarray, "rows columns"] | None:
    """Return the brightness of an Image; None if it does not have the size that it states."""
    encoding = str(message.encoding)
    channels = _CHANNELS.get(encoding)
    if channels is None:
        cure = "publish mono8 or rgb8"
        if encoding.startswith("bayer"):
            cure = "name the topic of image_proc's debayer node instead, image_color or image_mono"
        raise AcquisitionError(f"{topic}: images are encoded as {encoding}, {', '.join(_CHANNELS)} are read; {cure}")
    rows = int(message.height)
    columns = int(message.width)
    step = int(message.step)
    data = np.frombuffer(message.data, np.uint8)
    if step < columns * channels or data.size != rows * step or not data.size:
        return None
    image = data.reshape(rows, step)[:, : columns * channels].reshape(rows, columns, channels)
    return brightness(np.ascontiguousarray(image))
