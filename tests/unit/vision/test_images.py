"""Image files as cameras and other programs write them: whole or cut off, with a trailer, turned."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.vision import decoded_image, says_its_end

RNG = np.random.default_rng(7)
# Smooth, so that a JPEG is near to it; no corner is like another.
IMAGE = cv2.resize(RNG.integers(0, 255, (4, 5), dtype=np.uint8), (50, 40), interpolation=cv2.INTER_LINEAR)
IN_COLOUR = np.stack([IMAGE // 2, IMAGE, IMAGE // 3], axis=2)

ORIENTED = {
    1: lambda image: image,
    2: np.fliplr,
    3: lambda image: np.rot90(image, 2),
    4: np.flipud,
    5: lambda image: image.T,
    6: lambda image: np.rot90(image, -1),
    7: lambda image: np.rot90(image, 2).T,
    8: np.rot90,
}
"""What is shown of an image of each orientation (Exif 2.32, 4.6.4)."""


def encoded(suffix: str, image: np.ndarray = IMAGE, *options: int) -> bytes:
    return cv2.imencode(suffix, image, options)[1].tobytes()


def exif(orientation: int) -> bytes:
    return b"II*\0\x08\0\0\0" + struct.pack("<HHHIHHI", 1, 0x0112, 3, 1, orientation, 0, 0)


def in_jpeg(segment: bytes, data: bytes) -> bytes:
    """A JPEG with a segment of its application."""
    return data[:2] + b"\xff\xe1" + struct.pack(">H", 2 + len(segment)) + segment + data[2:]


def in_png(name: bytes, content: bytes, data: bytes) -> bytes:
    """A PNG with one chunk more, behind its header."""
    return (
        data[:33]
        + struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
        + data[33:]
    )


PREVIEW = encoded(".jpg", IMAGE[:10, :10])
FILES = {
    "JPEG": encoded(".jpg"),
    "progressive JPEG": encoded(".jpg", IN_COLOUR, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "JPEG with restarts": encoded(".jpg", IN_COLOUR, cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
    "JPEG with a preview": in_jpeg(b"Exif\0\0" + exif(1) + PREVIEW, encoded(".jpg")),
    "PNG": encoded(".png"),
    "PNG with the name of the end in a text": in_png(b"tEXt", b"Comment\0IEND\xaeB`\x82", encoded(".png")),
}

TRAILERS = {
    "a line end": b"\r\n",
    "a fill byte": b"\xff",
    "a maker's data": b"SEFH" + bytes(range(256)) * 20 + b"SEFT",
    "a second picture": PREVIEW,
    "a second picture, cut off": PREVIEW[:40],
}


@pytest.mark.parametrize("trailer", TRAILERS)
@pytest.mark.parametrize("name", FILES)
def test_what_follows_the_end_is_ignored_once_it_has_settled(name: str, trailer: str) -> None:
    plain = decoded_image(FILES[name])
    longer = decoded_image(FILES[name] + TRAILERS[trailer])
    assert plain is not None
    assert np.abs(plain.astype(int) - IMAGE).max() < 12
    np.testing.assert_array_equal(plain, longer)
    assert says_its_end(FILES[name])
    assert says_its_end(FILES[name] + bytes(3000))
    assert not says_its_end(FILES[name] + TRAILERS[trailer])


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_cut_off_anywhere_is_no_image(name: str) -> None:
    data = FILES[name]
    for end in range(len(data)):
        assert decoded_image(data[:end]) is None, end
        # Some programs reserve the whole file first.
        assert decoded_image(data[:end].ljust(len(data), b"\0")) is None or data[end:].strip(b"\0") == b"", end
        assert not says_its_end(data[:end])


@pytest.mark.parametrize("orientation", ORIENTED)
def test_an_image_is_turned_as_its_orientation_says(orientation: int) -> None:
    shown = ORIENTED[orientation](IMAGE)
    jpeg = decoded_image(in_jpeg(b"Exif\0\0" + exif(orientation), encoded(".jpg")))
    png = decoded_image(in_png(b"eXIf", exif(orientation), encoded(".png", IN_COLOUR)))
    assert jpeg is not None
    assert np.abs(jpeg.astype(int) - shown).max() < 12
    np.testing.assert_array_equal(png, shown)


@pytest.mark.parametrize("orientation", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_turns_nothing(orientation: int) -> None:
    np.testing.assert_array_equal(decoded_image(in_png(b"eXIf", exif(orientation), encoded(".png"))), IMAGE)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".tif"])
def test_an_image_without_a_tag_is_as_it_was_saved(suffix: str) -> None:
    np.testing.assert_array_equal(decoded_image(encoded(suffix)), IMAGE)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_pixels_of_16_bits_are_refused_and_not_scaled(suffix: str) -> None:
    with pytest.raises(ConfigError, match="pixels of uint16"):
        decoded_image(encoded(suffix, IMAGE.astype(np.uint16) * 257))
