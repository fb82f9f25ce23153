"""The newest images of a run, handed from the process that searches to the one that shows them.

They are kept in an anonymous memory file (memfd), which the system frees when the last process closes it. The
process that searches writes each image over an old one, and waits for nobody. A reader that is too late, or finds an
image that is not whole, makes it of the samples in the journal.
"""

from __future__ import annotations

import os
import stat
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from markerseek._closing import Closing
from markerseek.core import AcquisitionError, ChannelFrame, ConfigError, Measured, PaImage
from markerseek.records.journal import Journal, JournalEvent
from markerseek.signals import ImageReader

SLOTS = 16
"""Images that are kept: a reader may be as many entries late."""

MAX_SLOT_BYTES = 1 << 22
"""Largest image that is handed on, with its head; that of the simulated probe has half a megabyte."""

_NUMBER = struct.Struct("<Q")
_SHAPE = struct.Struct("<II")
_HEAD_BYTES = _NUMBER.size + _SHAPE.size
"""Before each image: number of its entry, 0 while the image is written; then its rows and columns.

The lateral positions and the depths follow as float64, and then the envelope as float32, row after row."""


class ImageRing(Closing):
    """The images of the newest entries of one journal: one process puts them in, another one gets them.

    ``descriptor``: of a file that only these two have open, and only for this.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    @classmethod
    def create(cls) -> Self | None:
        """Make an empty one; None where the system has, or allows, no files in memory without a name."""
        try:
            return cls(os.memfd_create("markerseek-images"))
        except (AttributeError, OSError):
            # macOS has none; a Linux may be set to refuse them.
            return None

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open that of another process by the name of an inherited descriptor, ``/dev/fd/N``.

        Raises `ConfigError` if it is none.
        """
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        except OSError as problem:
            raise ConfigError(f"{path}: no images can be handed on there: {problem.strerror}") from problem
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink:
            os.close(descriptor)
            raise ConfigError(f"{path}: images are handed on in a file without a name; leave it to the program")
        return cls(descriptor)

    def fileno(self) -> int:
        """Return its descriptor, for a child that inherits it."""
        return self._descriptor

    def put(self, number: int, image: PaImage) -> None:
        """Put the image of an entry in, over an older one; without room for it, nothing is handed on."""
        parts = [
            memoryview(_SHAPE.pack(*image.envelope.shape)),
            *(_stored(image.lateral_m, "<f8"), _stored(image.depth_m, "<f8"), _stored(image.envelope, "<f4")),
        ]
        size = sum(map(len, parts))
        if _NUMBER.size + size > MAX_SLOT_BYTES:
            return
        place = number % SLOTS * MAX_SLOT_BYTES
        with suppress(OSError):
            # As in a sequence lock: a reader that finds one number before and after it has the whole image. Eight bytes
            # are written at once.
            os.pwrite(self._descriptor, _NUMBER.pack(0), place)
            if os.pwritev(self._descriptor, parts, place + _NUMBER.size) == size:
                os.pwrite(self._descriptor, _NUMBER.pack(number), place)

    def get(self, number: int) -> PaImage | None:
        """Return the image of an entry; None if it never came, is not whole, or another one is in its place."""
        place = number % SLOTS * MAX_SLOT_BYTES
        head = os.pread(self._descriptor, _HEAD_BYTES, place)
        if len(head) < _HEAD_BYTES or head[: _NUMBER.size] != _NUMBER.pack(number):
            return None
        rows, columns = _SHAPE.unpack_from(head, _NUMBER.size)
        depths_at = 8 * columns
        envelope_at = depths_at + 8 * rows
        size = envelope_at + 4 * rows * columns
        if _HEAD_BYTES + size > MAX_SLOT_BYTES:
            return None
        data = os.pread(self._descriptor, size, place + _HEAD_BYTES)
        if len(data) < size or os.pread(self._descriptor, _HEAD_BYTES, place) != head:
            return None
        return PaImage(
            envelope=np.frombuffer(data, "<f4", offset=envelope_at).reshape(rows, columns),
            lateral_m=np.frombuffer(data, "<f8", count=columns),
            depth_m=np.frombuffer(data, "<f8", count=rows, offset=depths_at),
        )

    def close(self) -> None:
        """Release it; allowed twice."""
        if self._descriptor >= 0:
            descriptor = self._descriptor
            self._descriptor = -1
            os.close(descriptor)


def hand_images_on(images: ImageRing, journal: Journal, imaging: ImageReader) -> None:
    """Put the image of each acquisition in before its entry is written, so that whoever follows the journal finds it.

    ``imaging``: the reader of the run, which has made the image for its reading.
    """

    def put(number: int, event: JournalEvent) -> None:
        if isinstance(event, Measured) and isinstance(event.sample.frame, ChannelFrame):
            # Of a recording with intensities of its own, a frame may be one of another probe.
            with suppress(AcquisitionError):
                images.put(number, imaging.picture(event.sample.frame))

    journal.before_entry = put


def _stored(values: np.ndarray[Any, Any], dtype: str) -> memoryview:
    return np.ascontiguousarray(values, dtype).data.cast("B")
