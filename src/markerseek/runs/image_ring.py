"""The newest images of a run, handed from the process that searches to the one that shows them.

They lie in memory, in a file without a name, which ends with the last process that has it open, however that ends. The
process that searches writes each image over an old one, and waits for nobody. A reader that is too late, or finds an
image torn, makes the image of the samples in the journal (decision 78).
"""

from __future__ import annotations

import os
import stat
import struct
import zlib
from collections.abc import Iterable
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

_HEAD = struct.Struct("<QIII")
"""Before each image: number of its entry, its rows and columns, and the CRC-32 of these three and of what follows.

The lateral positions and the depths follow as float64, and then the envelope as float32, row after row."""


class ImageRing(Closing):
    """The images of the newest entries of one journal: one process puts them in, another one gets them.

    ``descriptor``: of a file that only these two have open, and only for this.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    @classmethod
    def create(cls) -> Self | None:
        """Make an empty one; None where the system has no files in memory without a name."""
        make = getattr(os, "memfd_create", None)
        return None if make is None else cls(make("markerseek-images"))

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
        rows, columns = image.envelope.shape
        parts = [_stored(image.lateral_m, "<f8"), _stored(image.depth_m, "<f8"), _stored(image.envelope, "<f4")]
        if _HEAD.size + sum(map(len, parts)) > MAX_SLOT_BYTES:
            return
        head = _HEAD.pack(number, rows, columns, _checksum(number, rows, columns, parts))
        # What a lack of memory leaves of it does not agree with its checksum.
        with suppress(OSError):
            os.pwritev(self._descriptor, [head, *parts], _place(number))

    def get(self, number: int) -> PaImage | None:
        """Return the image of an entry; None if it never came, is overwritten, or was torn."""
        head = os.pread(self._descriptor, _HEAD.size, _place(number))
        if len(head) < _HEAD.size:
            return None
        found, rows, columns, checksum = _HEAD.unpack(head)
        ends = (8 * columns, 8 * (columns + rows), 8 * (columns + rows) + 4 * rows * columns)
        if found != number or _HEAD.size + ends[-1] > MAX_SLOT_BYTES:
            return None
        data = os.pread(self._descriptor, ends[-1], _place(number) + _HEAD.size)
        if len(data) < ends[-1] or _checksum(number, rows, columns, [data]) != checksum:
            return None
        lateral_m = np.frombuffer(data[: ends[0]], "<f8")
        depth_m = np.frombuffer(data[ends[0] : ends[1]], "<f8")
        envelope = np.frombuffer(data, "<f4", offset=ends[1]).reshape(rows, columns)
        return PaImage(envelope=envelope, lateral_m=lateral_m, depth_m=depth_m)

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


def _place(number: int) -> int:
    """Return where the image of an entry begins; what no image reaches takes no memory."""
    return number % SLOTS * MAX_SLOT_BYTES


def _stored(values: np.ndarray[Any, Any], dtype: str) -> memoryview:
    return np.ascontiguousarray(values, dtype).data.cast("B")


def _checksum(number: int, rows: int, columns: int, parts: Iterable[bytes | memoryview]) -> int:
    checksum = zlib.crc32(_HEAD.pack(number, rows, columns, 0))
    for each in parts:
        checksum = zlib.crc32(each, checksum)
    return checksum
