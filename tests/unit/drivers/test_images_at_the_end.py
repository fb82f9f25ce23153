"""A program that ends while images are read: with its own exit code, also if its source is never closed."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.unit.drivers.network_camera import serving

pytestmark = pytest.mark.real_time

READING = """
import sys, time
from pathlib import Path
from markerseek.drivers import open_stereo_images
from markerseek.geometry import Camera

how, size_px, words = sys.argv[1], (int(sys.argv[2]), int(sys.argv[3])), sys.argv[4:]
camera = Camera(focal_px=(5e3, 5e3), centre_px=(size_px[0] / 2, size_px[1] / 2), size_px=size_px)
source = open_stereo_images(words, left=camera, right=camera)
if Path(words[0]).is_dir():
    data = (Path(words[0]).parent / "large.jpg").read_bytes()
    for number in range(8):
        for word in words:
            (Path(word) / f"{number}.jpg").write_bytes(data)
time.sleep(0.4)
if how == "closed":
    source.close()
elif how == "interrupted":
    with source:
        raise KeyboardInterrupt
elif how == "failed":
    raise ValueError
"""

CODES = {"closed": 0, "interrupted": 130, "failed": 1, "never closed": 0}


def end(how: str, size_px: tuple[int, int], words: list[str]) -> tuple[int, str]:
    """Exit code, and what is printed, of a program that ends while it reads images."""
    command = [sys.executable, "-c", READING, how, *map(str, size_px), *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    # Python ends itself by the signal after a KeyboardInterrupt.
    return (130 if done.returncode == -2 else done.returncode), done.stderr


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a JPEG of 20 megapixels, which is decoded in a few tenths of a second."""
    folder = tmp_path_factory.mktemp("large")
    small = np.random.default_rng(1).integers(0, 255, (400, 500, 3)).astype(np.uint8)
    cv2.imwrite(str(folder / "large.jpg"), cv2.resize(small, (5000, 4000)))
    return folder


@pytest.mark.parametrize("how", CODES)
def test_a_program_ends_with_its_own_code_while_large_images_are_decoded(how: str, large: Path) -> None:
    folders = [large / how / side for side in ("left", "right")]
    for folder in folders:
        folder.mkdir(parents=True)
    (large / how / "large.jpg").hardlink_to(large / "large.jpg")
    code, said = end(how, (5000, 4000), [*map(str, folders)])
    assert code == CODES[how], said
    assert "terminate" not in said
    assert "not rethrown" not in said


@pytest.mark.parametrize("how", ["closed", "never closed"])
def test_a_program_ends_while_a_video_is_read(how: str, tmp_path: Path) -> None:
    words = []
    for side in ("left", "right"):
        words.append(str(tmp_path / f"{side}.avi"))
        writer = cv2.VideoWriter(words[-1], cv2.VideoWriter.fourcc(*"MJPG"), 100.0, (1920, 1080))
        for value in range(60):
            writer.write(np.full((1080, 1920, 3), value, np.uint8))
        writer.release()
    assert end(how, (1920, 1080), words) == (0, "")


class _Frozen(BaseHTTPRequestHandler):
    """A network camera that freezes after 20 images, with its connection open."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        data = cv2.imencode(".jpg", np.full((128, 160, 3), 90, np.uint8))[1].tobytes()
        for _ in range(20):
            self.wfile.write(b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
            self.wfile.write(data + b"\r\n")
        self.wfile.flush()
        self.server.ends.wait(40)

    def log_message(self, *_: object) -> None:
        """Nothing."""


@pytest.fixture
def frozen() -> Iterator[str]:
    with serving(_Frozen) as at:
        yield at


@pytest.mark.parametrize("how", ["closed", "never closed"])
def test_a_camera_that_is_frozen_holds_the_end_up_for_seconds_only(how: str, frozen: str) -> None:
    began_s = time.monotonic()
    code, said = end(how, (160, 128), [f"{frozen}/left.mjpg", f"{frozen}/right.mjpg"])
    assert code == 0, said
    assert time.monotonic() - began_s < 20
