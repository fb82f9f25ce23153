"""Reads Ultrasonix ``.b8`` and ``.rf`` files, one frame at a time."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import Int16, RecordError, UInt8
from markerseek.files import MIB, as_read_error, open_input
from markerseek.wire import ultrasonix

# 64 GiB: hours of frames, which are read one at a time.
_LARGEST_BYTES = 1 << 36

_MAX_FRAME_BYTES = 64 * MIB
"""Largest frame: 512 lines of 65,536 samples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UltrasonixFile:
    """An Ultrasonix file with its decoded header."""

    path: Path
    header: ultrasonix.UltrasonixHeader

    def b_mode(self, index: int) -> UInt8[np.ndarray, "rows columns"]:
        """B-mode image, counted from 0."""
        self._require("b-mode")
        return ultrasonix.decode_b_mode(self._body(index), self.header)

    def rf(self, index: int) -> Int16[np.ndarray, "lines samples"]:
        """Radio-frequency lines of one frame, counted from 0; errors as of `b_mode`."""
        self._require("rf")
        return ultrasonix.decode_rf(self._body(index), self.header)

    def _require(self, kind: str) -> None:
        if self.header.kind != kind:
            raise RecordError(f"{self.path}: it holds {self.header.kind} frames, {kind} was asked for")

    def _body(self, index: int) -> bytes:
        header = self.header
        if not 0 <= index < header.frames:
            raise RecordError(f"{self.path}: there is no frame {index + 1}, it holds {header.frames}; count from 1")
        with as_read_error(self.path), open_input(self.path, most_bytes=_LARGEST_BYTES) as file:
            file.seek(ultrasonix.HEADER_BYTES + index * header.stride)
            body = file.read(header.stride)
        if len(body) != header.stride:
            raise RecordError(f"{self.path}: it became shorter while it was read; wait until it is written")
        return body


def open_ultrasonix(path: Path) -> UltrasonixFile:
    """File with its header, checked against its size."""
    with as_read_error(path), open_input(path, most_bytes=_LARGEST_BYTES) as file:
        head, size = file.read(ultrasonix.HEADER_BYTES), os.fstat(file.fileno()).st_size
    header = ultrasonix.decode_header(head, size=size, name=str(path))
    if header.stride > _MAX_FRAME_BYTES:
        raise RecordError(
            f"{path}: a frame has {header.stride} bytes, at most {_MAX_FRAME_BYTES} are read; the header is damaged: "
            "export it again"
        )
    return UltrasonixFile(path=path, header=header)
