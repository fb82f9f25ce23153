"""Frames of a Verasonics Vantage as `matlab/markerseek_send.m` sends them: a header, then int16 samples.

The header has 48 bytes, little-endian: the mark ``MSV1``, flags (bit 0: an emulator sends), the counter of frames, the
numbers of channels and samples (uint32 each), the time in seconds since 1970 (float64), and the name of the probe in 20
bytes. The samples follow channel after channel. A greeting is a frame with counter 0 and no channels.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from markerseek.core import AcquisitionError, Int16

MARK = b"MSV1"
MAX_CHANNELS = 1024
MAX_SAMPLES = 1 << 16
MAX_PROBE_BYTES = 20

_HEADER = struct.Struct(f"<4sIIIId{MAX_PROBE_BYTES}s")
_EMULATED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class VantageFrame:
    """One frame, or the greeting of a sender."""

    counter: int
    """Number of the frame since the sender was opened, from 1; 0: a greeting."""
    time_s: float
    """Time of day at the sender, in seconds since 1970."""
    probe: str
    """Name of the probe at the sender."""
    samples: Int16[np.ndarray, "channels samples"]
    emulated: bool = False
    """Whether an emulator has sent it."""


def encode(frame: VantageFrame) -> bytes:
    """Return the bytes of a frame."""
    channels, samples = frame.samples.shape
    probe = frame.probe.encode("ascii")
    header = _HEADER.pack(MARK, int(frame.emulated), frame.counter, channels, samples, frame.time_s, probe)
    return header + frame.samples.astype("<i2").tobytes()


class VantageFramer:
    """Cuts a stream of bytes into frames."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> Iterator[VantageFrame]:
        """Yield the frames that are complete with these bytes; `AcquisitionError` if a header cannot be one."""
        self._waiting += data
        while len(self._waiting) >= _HEADER.size:
            mark, flags, counter, channels, samples, time_s, name = _HEADER.unpack_from(self._waiting)
            probe = name.rstrip(b"\0")
            _require_header(mark, flags, counter, channels, samples, time_s, probe)
            end = _HEADER.size + 2 * channels * samples
            if len(self._waiting) < end:
                return
            counts = np.frombuffer(bytes(self._waiting[_HEADER.size : end]), "<i2").astype(np.int16)
            del self._waiting[:end]
            yield VantageFrame(
                counter=counter,
                time_s=time_s,
                probe=probe.decode("ascii"),
                samples=counts.reshape(channels, samples),
                emulated=bool(flags & _EMULATED),
            )


def _require_header(
    mark: bytes, flags: int, counter: int, channels: int, samples: int, time_s: float, probe: bytes
) -> None:
    if mark != MARK:
        raise AcquisitionError(f"a frame begins with {mark!r}, not with {MARK!r}; is the sender markerseek_send.m?")
    if flags > _EMULATED:
        raise AcquisitionError(f"a header has the flags {flags:#x}, which are not known; use this version's sender")
    if counter == 0 and (channels or samples):
        raise AcquisitionError(f"a greeting has {channels} channels x {samples} samples, it must have none")
    if counter and not (1 <= channels <= MAX_CHANNELS and 1 <= samples <= MAX_SAMPLES):
        raise AcquisitionError(
            f"a header says {channels} channels x {samples} samples, it must be 1 to {MAX_CHANNELS} x 1 to "
            f"{MAX_SAMPLES}; correct columns and rows of markerseek_send"
        )
    if not math.isfinite(time_s):
        raise AcquisitionError(f"a header has the time {time_s} s, it must be finite")
    if not (probe and probe.isascii() and probe.decode("ascii").isprintable()):
        raise AcquisitionError(f"a header has the probe {probe!r}, it must be 1 to {MAX_PROBE_BYTES} ASCII characters")
