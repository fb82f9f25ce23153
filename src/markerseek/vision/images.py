"""OpenCV, imported when it is first needed; images as other programs hand them on; a part of an image."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Annotated

import numpy as np

from markerseek.core import ConfigError, UInt8, Within, needs_package, require_fields

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".tif", ".tiff")
"""Endings of the names of image files that are read."""

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_END = b"IEND\xaeB`\x82"
_JPEG = b"\xff\xd8"
_JPEG_MARKER = re.compile(rb"\xff+([^\x00\x01\xd0-\xd7\xff])")
"""A marker of a segment, or of the end: neither the byte FF of coded pixels nor a restart within them."""

_JPEG_END = b"\xd9"

_PORTABLE = re.compile(rb"P([56])\s+(?:#[^\n]*\s+)*(\d+)\s+(?:#[^\n]*\s+)*(\d+)\s+(?:#[^\n]*\s+)*(\d+)\s")
_PURPOSE = "reading camera images"


def opencv(purpose: str) -> ModuleType:
    """Return the package ``cv2``.

    ``purpose``: what it is needed for, for the message.
    """
    with needs_package("opencv-python-headless", extra="vision", purpose=purpose, module="cv2"):
        import cv2
    return cv2


def brightness(image: np.ndarray) -> UInt8[np.ndarray, "rows columns"]:
    """Return the brightest colour of each pixel, without transparency, as `find_spot` has it.

    ``image``: shape (rows, columns), or (rows, columns, channels) with 1, 3 or 4 channels. Raises `ConfigError` if a
    pixel has more than 8 bits.
    """
    if image.dtype != np.uint8:
        raise ConfigError(f"the image has pixels of {image.dtype}, they must have 8 bits; save or send it with 8 bits")
    if image.ndim == 2:
        return image
    if image.shape[2] < 3:
        return np.ascontiguousarray(image[:, :, 0])
    # A maximum along the last axis takes five times as long.
    cv2 = opencv(_PURPOSE)
    first, second, third = cv2.split(image)[:3]
    return np.asarray(cv2.max(cv2.max(first, second), third))


def says_its_end(data: bytes) -> bool:
    """Return whether a file ends with the mark of its format, and so is whole although just written.

    False for a format without such a mark, and where something follows it: more of that may come.
    """
    end = _end(data)
    return end is not None and not data[end:].strip(b"\0")


def decoded_image(data: bytes) -> UInt8[np.ndarray, "rows columns"] | None:
    """Return the image of a PNG, JPEG, BMP, PGM, PPM or TIFF file; None if the file is not complete, or no image.

    It is turned as its EXIF orientation says, as OpenCV does unless it is told otherwise. What follows the end of a PNG
    or JPEG is ignored. Raises `ConfigError` if a pixel has more than 8 bits.
    """
    if not _may_be_whole(data):
        return None
    cv2 = opencv(_PURPOSE)
    try:
        # IMREAD_UNCHANGED would ignore the orientation, with which people calibrate their cameras.
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH)
    except cv2.error:
        return None
    return None if image is None else brightness(image)


def _may_be_whole(data: bytes) -> bool:
    """Return whether nothing shows that the end is missing; OpenCV fills up what is missing without saying so."""
    if data.startswith((_PNG, _JPEG)):
        return _end(data) is not None
    if data.startswith(b"BM"):
        return int.from_bytes(data[2:6], "little") <= len(data)
    if (portable := _PORTABLE.match(data)) is not None:
        kind, width, height, most = map(int, portable.groups())
        return len(data) - portable.end() >= width * height * (3 if kind == 6 else 1) * (2 if most > 255 else 1)
    return len(data) > 8


def _end(data: bytes) -> int | None:
    """Return the place behind the mark with which a PNG or JPEG ends; None if it is missing, or the format has none."""
    if data.startswith(_PNG):
        return _png_end(data)
    return _jpeg_end(data) if data.startswith(_JPEG) else None


def _png_end(data: bytes) -> int | None:
    """Return the place behind the last chunk: each has its length, its name, its content and a check sum."""
    place = len(_PNG)
    name = b""
    while name != b"IEND":
        if place + 12 > len(data):
            return None
        length = int.from_bytes(data[place : place + 4], "big")
        name = data[place + 4 : place + 8]
        place += 12 + length
    return place if data[:place].endswith(_PNG_END) else None


def _jpeg_end(data: bytes) -> int | None:
    """Return the place behind the mark of the end.

    A preview within a segment has such a mark of its own, and is skipped.
    """
    place = len(_JPEG)
    while (marker := _JPEG_MARKER.search(data, place)) is not None:
        place = marker.end()
        if marker[1] == _JPEG_END:
            return place
        # Every other segment states its length; coded pixels may follow it.
        place += int.from_bytes(data[place : place + 2], "big")
    return None


LARGEST_PX = 8192
"""Most rows or columns of an image."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rectangle:
    """Part of an image, in whole pixels."""

    row: Annotated[int, Within(-LARGEST_PX, LARGEST_PX, "pixels")]
    column: Annotated[int, Within(-LARGEST_PX, LARGEST_PX, "pixels")]
    """``row`` and ``column``: its upper left pixel."""
    rows: Annotated[int, Within(3, LARGEST_PX, "pixels")]
    columns: Annotated[int, Within(3, LARGEST_PX, "pixels")]

    def __post_init__(self) -> None:
        require_fields(self, "rectangle")

    def centred(self, row: float, column: float) -> Rectangle:
        """Return the same size, with its middle at a pixel."""
        return replace(self, row=round(row - (self.rows - 1) / 2), column=round(column - (self.columns - 1) / 2))

    def grown(self, rows: int, columns: int, *, shape: tuple[int, int]) -> Rectangle:
        """Return a rectangle larger by these numbers of pixels on each side, as far as the image reaches."""
        row = max(0, self.row - rows)
        column = max(0, self.column - columns)
        return Rectangle(
            row=row,
            column=column,
            rows=min(shape[0], self.row + self.rows + rows) - row,
            columns=min(shape[1], self.column + self.columns + columns) - column,
        )

    def within(self, shape: tuple[int, int]) -> Rectangle:
        """Return the part of it inside of an image; `ConfigError` if less than 3 pixels are left."""
        try:
            return self.grown(0, 0, shape=shape)
        except ConfigError:
            raise ConfigError(
                f"rectangle of {self.rows} × {self.columns} pixels at row {self.row}, column {self.column}: it lies "
                f"outside of the image of {shape[0]} × {shape[1]} pixels; name another"
            ) from None

    def relative_to(self, other: Rectangle) -> Rectangle:
        """Return the same part of the image, counted from the upper left pixel of another rectangle."""
        return replace(self, row=self.row - other.row, column=self.column - other.column)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of its pixels in an image that contains it."""
        return slice(self.row, self.row + self.rows), slice(self.column, self.column + self.columns)
