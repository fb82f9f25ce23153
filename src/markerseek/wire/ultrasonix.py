"""Ultrasonix ``.b8`` files as bytes: a header of 19 int32, then frame after frame, little-endian.

They hold B-mode images after scan conversion: uint8, row after row. Software 5.x writes the frame's number in four
bytes before each frame, later ones do not; the file's size shows which.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from markerseek.core import RecordError, UInt8

HEADER_BYTES = 76
"""Length of the header."""

_LAYOUT = struct.Struct("<19i")
_TAG_BYTES = 4
_B_MODE, _BITS = 4, 8
"""Type of the files that are read, and the bits of a pixel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UltrasonixHeader:
    """Header of one file."""

    frames: int
    width: int
    height: int
    """``width`` and ``height``: columns and rows of an image."""
    tagged: bool
    """Whether each frame begins with its number."""

    @property
    def stride(self) -> int:
        """Bytes from one frame to the next."""
        return self.width * self.height + _TAG_BYTES * self.tagged

    @property
    def file_bytes(self) -> int:
        """Size of the complete file in bytes."""
        return HEADER_BYTES + self.frames * self.stride


def decode_header(head: bytes, *, size: int, name: str) -> UltrasonixHeader:
    """Header of a file, checked against its size.

    ``head``: first 76 bytes of the file. ``size``: size of the file in bytes. ``name``: name of the file, for the
    message. Raises `RecordError` if it is of another type, or its size is another; the message names what was found and
    expected.
    """
    if len(head) < HEADER_BYTES:
        raise RecordError(f"{name}: {size} bytes, too short for a header of {HEADER_BYTES} bytes; export it again")
    number, frames, width, height, bits, *_ = _LAYOUT.unpack(head[:HEADER_BYTES])
    if number != _B_MODE:
        raise RecordError(
            f"{name}: data of type {number} found, and {_B_MODE} (.b8, B-mode) is read; export that, or, if it is one, "
            "its header is damaged"
        )
    if min(frames, width, height) < 1:
        raise RecordError(
            f"{name}: {frames} frames of {width} × {height} found, at least one of each expected; the header is "
            "damaged: export it again"
        )
    if bits != _BITS:
        raise RecordError(
            f"{name}: it holds images of {bits} bits, of which only those of {_BITS} bits are read; export it with "
            f"{_BITS} bits, or, if its header is damaged, again"
        )
    # Nothing in the header says whether frames are tagged: both sizes are tried.
    headers = [UltrasonixHeader(frames=frames, width=width, height=height, tagged=tagged) for tagged in (False, True)]
    for header in headers:
        if header.file_bytes == size:
            return header
    raise RecordError(
        f"{name}: {size} bytes, {headers[0].file_bytes} expected, or {headers[1].file_bytes} with numbered frames; "
        "it is cut off or damaged: export it again"
    )


def decode_b_mode(body: bytes, header: UltrasonixHeader) -> UInt8[np.ndarray, "rows columns"]:
    """B-mode image of one frame, from the bytes of its stride."""
    pixels = np.frombuffer(body, dtype=np.uint8, offset=_TAG_BYTES * header.tagged)
    return pixels.reshape(header.height, header.width)
