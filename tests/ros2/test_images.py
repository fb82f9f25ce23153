"""Image topics of another node: encodings, reliabilities, stamps, and a node that ends."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.ros2.ros_processes import Start

pytest.importorskip("rclpy", reason="needs ROS 2; run by: make ros2")

from markerseek.core import AcquisitionError, ConfigError, NotConnectedError, StereoPair
from markerseek.drivers import RosImages, open_stereo_images
from markerseek.geometry import Camera

PUBLISHER = Path(__file__).with_name("image_publisher.py")
TOPICS = "/stereo/left/image_raw", "/stereo/right/image_raw"
CAMERA = Camera(focal_px=(150.0, 150.0), centre_px=(79.5, 63.5), size_px=(160, 128))


def published(
    start: Start, encoding: str, *, reliability: str = "RELIABLE", columns: int = 160, offset_s: float = 0.004
):
    suffix = "/compressed" if encoding == "jpeg" else ""
    topics = [topic + suffix for topic in TOPICS]
    return topics, start(sys.executable, PUBLISHER, *topics, encoding, reliability, columns, offset_s)


def pairs_of(
    source: RosImages, until: Callable[[list[StereoPair]], bool], *, limit_s: float = 20.0
) -> list[StereoPair]:
    found: list[StereoPair] = []
    ends_s = time.monotonic() + limit_s
    while not until(found):
        assert time.monotonic() < ends_s, len(found)
        found += source.newest()
        time.sleep(0.02)
    return found


@pytest.mark.parametrize(
    ("encoding", "reliability"),
    [
        ("mono8", "RELIABLE"),
        ("mono8", "BEST_EFFORT"),
        ("rgb8", "RELIABLE"),
        ("bgra8", "RELIABLE"),
        ("jpeg", "BEST_EFFORT"),
    ],
)
def test_pairs_of_one_stamp_come_in_order_until_the_node_ends(start: Start, encoding: str, reliability: str) -> None:
    topics, process = published(start, encoding, reliability=reliability)
    words = [f"topic:{topic}" for topic in topics]
    began_s = time.monotonic()
    with open_stereo_images(words, left=CAMERA, right=CAMERA) as source:
        found = pairs_of(source, lambda pairs: len(pairs) >= 30)
        ended_s = time.monotonic()
        process.kill()
        with pytest.raises(NotConnectedError, match=r"image_raw.*no image for [23] s; start its node"):
            pairs_of(source, lambda _: False)
    off = 1 if encoding == "jpeg" else 0
    for pair in found:
        assert pair.left.shape == (128, 160)
        assert np.ptp(pair.left) <= off
        assert np.abs(pair.left.astype(int) - pair.right).max() <= 2 * off
    steps = np.diff([int(pair.left[0, 0]) for pair in found])
    # Not every image need come, and none comes twice; JPEG is not exact.
    assert steps.min() >= 1 - off
    assert np.median(steps) == 1
    times_s = [began_s, *(pair.at_s for pair in found), ended_s]
    assert times_s == sorted(times_s)


def test_images_of_a_megabyte_are_heard(start: Start) -> None:
    camera = Camera(focal_px=(150.0, 150.0), centre_px=(79.5, 63.5), size_px=(10240, 128))
    topics, _ = published(start, "mono8", columns=10240)
    with RosImages((topics[0], topics[1]), (camera, camera)) as source:
        pairs_of(source, bool)
        found = pairs_of(source, lambda pairs: len(pairs) >= 20, limit_s=10)
    assert len({int(pair.left[0, 0]) for pair in found}) == len(found)


@pytest.mark.parametrize(
    ("encoding", "columns", "offset_s", "message"),
    [
        ("mono16", 160, 0.0, "images are encoded as mono16, mono8, .* are read; publish mono8 or rgb8"),
        ("bayer_rggb8", 160, 0.0, "images are encoded as bayer_rggb8, .*; name the topic of image_proc's debayer node"),
        ("mono8", 161, 0.0, "images of 161 x 128 pixels, the camera's calibration is of 160 x 128"),
        ("mono8", 160, 0.015, "no pair among them; images of a pair carry stamps that differ by at most 10 ms"),
    ],
)
def test_images_that_cannot_be_used_are_refused(
    start: Start, encoding: str, columns: int, offset_s: float, message: str
) -> None:
    topics, _ = published(start, encoding, columns=columns, offset_s=offset_s)
    # The first image may come while the source still waits for the other topic.
    with (
        pytest.raises(AcquisitionError, match=message),
        RosImages((topics[0], topics[1]), (CAMERA, CAMERA)) as source,
    ):
        pairs_of(source, lambda _: False)


def test_topics_that_carry_nothing_or_something_else_are_refused(start: Start) -> None:
    with pytest.raises(NotConnectedError, match="/a and /b do not both have a publisher within 1 s; start"):
        RosImages(("/a", "/b"), (CAMERA, CAMERA), connect_s=1.0)
    topics, _ = published(start, "mono8")
    with pytest.raises(NotConnectedError, match=r"right/image_raw/compressed do not both have a publisher"):
        RosImages((topics[0], f"{topics[1]}/compressed"), (CAMERA, CAMERA), connect_s=2.5)
    with pytest.raises(ConfigError, match="given for both cameras"):
        RosImages((topics[0], topics[0]), (CAMERA, CAMERA))
