"""Ultrasonix ``.b8`` and ``.rf`` files as bytes: a header of 19 int32, then frame after frame.

``.b8`` (type 4) holds B-mode images after scan conversion: uint8, row after row. ``.rf`` (type 16) holds lines of
radio frequency after the machine's own beamforming: int16, line after line. Software 5.x writes the frame's number in
four bytes before each frame, later ones do not; the file's size shows which. Little-endian throughout.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal

import numpy as np

from markerseek.core import Int16, RecordError, UInt8

HEADER_BYTES = 76
"""Length of the header."""

_LAYOUT = struct.Struct("<19i")
_TAG_BYTES = 4
_KINDS: dict[int, Literal["b-mode", "rf"]] = {4: "b-mode", 16: "rf"}
_BITS = {"b-mode": 8, "rf": 16}


@dataclass(frozen=True, slots=True, kw_only=True)
class UltrasonixHeader:
    """Header of one file."""

    kind: Literal["b-mode", "rf"]
    """Whether it holds B-mode images or radio-frequency lines."""
    frames: int
    width: int
    height: int
    """``width`` and ``height``: columns and rows of an image; or lines, and samples of each."""
    sampling_hz: int
    """Sampling frequency of the lines; not of B-mode images."""
    line_density: int
    """Lines over the probe's width."""
    tagged: bool
    """Whether each frame begins with its number."""

    @property
    def stride(self) -> int:
        """Bytes from one frame to the next."""
        return self.width * self.height * _BITS[self.kind] // 8 + _TAG_BYTES * self.tagged

    @property
    def file_bytes(self) -> int:
        """Size of the complete file in bytes."""
        return HEADER_BYTES + self.frames * self.stride


def decode_header(head: bytes, *, size: int, name: str) -> UltrasonixHeader:
    """Return the header of a file, checked against its size.

    ``head``: first 76 bytes of the file. ``size``: size of the file in bytes. ``name``: name of the file, for the
    message. Raises `RecordError` if it is of another type, or its size is another; the message names what was found and
    expected.
    """
    if len(head) < HEADER_BYTES:
        raise RecordError(f"{name}: {size} bytes, too short for a header of {HEADER_BYTES} bytes; export it again")
    number, frames, width, height, bits, *_, sampling_hz, _, density, _ = _LAYOUT.unpack(head[:HEADER_BYTES])
    kind = _KINDS.get(number)
    if kind is None:
        raise RecordError(
            f"{name}: data of type {number} found, and 4 (.b8, B-mode) or 16 (.rf) are read; export one of these, or, "
            "if it is one, its header is damaged"
        )
    if min(frames, width, height) < 1:
        raise RecordError(
            f"{name}: {frames} frames of {width} × {height} found, at least one of each expected; the header is "
            "damaged: export it again"
        )
    if bits != _BITS[kind]:
        raise RecordError(
            f"{name}: it holds {kind} frames of {bits} bits, and only frames of "
            f"{_BITS[kind]} bits are read; export it with {_BITS[kind]} bits, or, if its header is damaged, again"
        )
    # Nothing in the header says whether frames are tagged: both sizes are tried.
    headers = [
        UltrasonixHeader(
            kind=kind,
            frames=frames,
            width=width,
            height=height,
            sampling_hz=sampling_hz,
            line_density=density,
            tagged=tagged,
        )
        for tagged in (False, True)
    ]
    for header in headers:
        if header.file_bytes == size:
            return header
    raise RecordError(
        f"{name}: {size} bytes, {headers[0].file_bytes} expected, or {headers[1].file_bytes} with numbered frames; "
        "it is cut off or damaged: export it again"
    )


def decode_b_mode(body: bytes, header: UltrasonixHeader) -> UInt8[np.ndarray, "rows columns"]:
    """Return the B-mode image of one frame, from the bytes of its stride."""
    pixels = np.frombuffer(body, dtype=np.uint8, offset=_TAG_BYTES * header.tagged)
    return pixels.reshape(header.height, header.width)


def decode_rf(body: bytes, header: UltrasonixHeader) -> Int16[np.ndarray, "lines samples"]:
    """Return the radio-frequency lines of one frame, from the bytes of its stride."""
    samples = np.frombuffer(body, dtype="<i2", offset=_TAG_BYTES * header.tagged)
    return samples.reshape(header.width, header.height).astype(np.int16, copy=False)
