"""Videos that OpenCV has written, and a camera behind the network that stops."""

from __future__ import annotations

import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import cv2
import numpy as np
import pytest

from markerseek.core import AcquisitionError, ConfigError, DeviceError, NotConnectedError, StereoPair
from markerseek.drivers import VideoImages, open_stereo_images
from markerseek.geometry import Camera
from tests.unit.drivers.network_camera import serving

pytestmark = pytest.mark.real_time

CAMERA = Camera(focal_px=(150.0, 150.0), centre_px=(79.5, 63.5), size_px=(160, 128))
CAMERAS = (CAMERA, CAMERA)


def video(path: Path, values: range, *, columns: int = 160, halves: int = 0) -> str:
    """An AVI whose image n is even, of brightness n; ``halves``: by how much its right half is brighter."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (columns, 128))
    assert writer.isOpened()
    for value in values:
        image = np.full((128, columns, 3), value, np.uint8)
        image[:, columns // 2 :] += halves
        writer.write(image)
    writer.release()
    return str(path)


def until_it_ends(source: VideoImages, *, limit_s: float) -> tuple[list[StereoPair], DeviceError]:
    found: list[StereoPair] = []
    ends_s = time.monotonic() + limit_s
    while time.monotonic() < ends_s:
        try:
            found += source.newest()
        except DeviceError as problem:
            return found, problem
        time.sleep(0.02)
    raise AssertionError(found)


@pytest.mark.parametrize("side_by_side", [False, True])
def test_videos_are_played_at_their_frame_rate_pair_by_pair_to_their_end(tmp_path: Path, side_by_side: bool) -> None:
    values = range(20, 220, 4)
    if side_by_side:
        words = [video(tmp_path / "both.avi", values, columns=320, halves=10)]
    else:
        words = [
            video(tmp_path / "left.avi", values),
            video(tmp_path / "right.avi", range(30, 230, 4)),
        ]
    with open_stereo_images(words, left=CAMERA, right=CAMERA) as source:
        found, problem = until_it_ends(source, limit_s=15)
    np.testing.assert_allclose([pair.left.mean() for pair in found], values, atol=1.5)
    np.testing.assert_allclose([pair.right.mean() for pair in found], np.add(values, 10), atol=1.5)
    # A busy computer is late now and then; it makes it up.
    assert np.median(np.diff([pair.at_s for pair in found])) == pytest.approx(0.04, abs=0.01)
    assert isinstance(problem, AcquisitionError)
    assert "the video has ended after 50 images" in str(problem)


class _Camera(BaseHTTPRequestHandler):
    """A network camera: 60 images of 30 a second, then silence with the connection open."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        for number in range(60):
            data = cv2.imencode(".jpg", np.full((128, 160, 3), 3 * number, np.uint8))[1].tobytes()
            self.wfile.write(b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
            self.wfile.write(data + b"\r\n")
            self.wfile.flush()
            time.sleep(1 / 30)
        self.server.ends.wait(20)

    def log_message(self, *_: object) -> None:
        """Nothing."""


@pytest.fixture
def address() -> Iterator[str]:
    with serving(_Camera) as at:
        yield at


def test_a_camera_gives_new_images_and_its_silence_is_an_error(address: str) -> None:
    with open_stereo_images(f"{address}/left.mjpg {address}/right.mjpg", left=CAMERA, right=CAMERA) as source:
        # Nobody asks for images meanwhile.
        time.sleep(1.0)
        first = source.newest()
        found, problem = until_it_ends(source, limit_s=15)
    assert len(found) > 15
    # What waited for a second was paired meanwhile.
    assert first[0].at_s < first[-1].at_s - 0.3
    for pair in first + found:
        assert abs(pair.left.mean() - pair.right.mean()) < 12
    assert isinstance(problem, NotConnectedError)
    assert "no image for 2 s; check that the camera runs" in str(problem)


def test_what_is_no_video_of_these_cameras_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.mp4"
    text.write_text("no video")
    small = video(tmp_path / "small.avi", range(3), columns=96)
    with pytest.raises(ConfigError, match="it cannot be read as a video"):
        VideoImages((str(text), small), CAMERAS)
    with pytest.raises(ConfigError, match="one is a camera and the other a file"):
        VideoImages(("0", small), CAMERAS)
    with pytest.raises(NotConnectedError, match="/dev/video97: no camera can be opened"):
        VideoImages(("/dev/video97", "/dev/video98"), CAMERAS)
    with VideoImages((small, video(tmp_path / "other.avi", range(3))), CAMERAS) as source:
        problem = until_it_ends(source, limit_s=5)[1]
    assert "small.avi: images of 96 x 128 pixels, the camera's calibration is of 160 x 128" in str(problem)
    with VideoImages((small,), CAMERAS) as source:
        problem = until_it_ends(source, limit_s=5)[1]
    assert "two side by side as calibrated would have 320 x 128" in str(problem)
