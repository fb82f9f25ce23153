"""Images of a camera that are none, or are far larger than their files, are refused in our words."""

from __future__ import annotations

import zlib

import pytest

from markerseek.core import RecordError
from markerseek.records import read_camera_images


def chunk(kind: bytes, data: bytes) -> bytes:
    return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")


def png_of(width: int, height: int) -> bytes:
    """A grey PNG of zeros."""
    head = width.to_bytes(4, "big") + height.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0])
    rows = zlib.compress(bytes((width + 1) * height), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (lambda: b"", "it is empty; export it again"),
        (lambda: png_of(1 << 15, 1 << 15), "far larger than its file, or damaged; export it again"),
        (lambda: b"no image", "or of another kind; export it again"),
    ],
)
def test_what_is_no_image_is_said(tmp_path, data, says):
    pytest.importorskip("cv2")
    (tmp_path / "0.png").write_bytes(data())
    with pytest.raises(RecordError, match=rf"0\.png: it cannot be read as an image.*{says}$") as problem:
        read_camera_images(tmp_path)
    assert "\n" not in str(problem.value)


def test_a_plain_image_is_read(tmp_path):
    pytest.importorskip("cv2")
    (tmp_path / "0.png").write_bytes(png_of(40, 30))
    (image,) = read_camera_images(tmp_path)
    assert image.shape == (30, 40)
