"""SonixDAQ channel files as bytes: one file per channel, little-endian, a short header and then int16.

Two layouts are in use. SDK 6 and later: three int32 (channel, frames, samples), files ``CH000.daq``. Earlier: two
int32 (frames, samples), files ``CH000-0000.daq``. The size decides, for names are easily changed. The header of 19
int32 that some public readers skip belongs to ``.rf`` and ``.b8`` files, not to these.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from markerseek.core import Int16, RecordError

CHANNEL_COUNT = 128
"""Channels, and files, of one acquisition."""

MAX_SAMPLES = 1 << 16
"""Most samples of one pulse that are read: sound travels 2.5 m meanwhile, and all channels take 16 MiB."""

MAX_BURST_BYTES = 2 << 30
"""Most that all channels of a sweep may hold, each of its pulses by itself."""

HEADER_BYTES = 12
"""Length of the longer header: the bytes that `decode_header` needs."""

TAIL_BYTES = 128
"""Bytes at the end of a file that are all 0 only if its contents have not come: 64 samples of noise never are."""

_NAME = re.compile(r"CH(\d{3})(?:-\d{4})?\.daq", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class DaqHeader:
    """Header of one channel file."""

    length: int
    """Bytes of the header: 12 (SDK 6 and later) or 8."""
    frames: int
    """Repeated pulses in the file."""
    samples: int
    channel: int | None = field(default=None, compare=False)
    """Number of the file, where the header holds it; it differs from file to file and is not compared."""

    @property
    def file_bytes(self) -> int:
        """Size of the complete file in bytes."""
        return self.length + 2 * self.frames * self.samples


def file_number(name: str) -> int | None:
    """Return the number k of the channel file of that name, 0 to 127; None if it is no channel file."""
    match = _NAME.fullmatch(name)
    if match is None or int(match[1]) >= CHANNEL_COUNT:
        return None
    return int(match[1])


def file_name(number: int) -> str:
    """Return the name of the channel file k as SDK 6 and later give it; earlier ones write CH000-0000.daq."""
    return f"CH{number:03d}.daq"


def element_of_file(number: int) -> int:
    """Return the element along the array whose sound is in file k, both counted from 0: 16 (k mod 8) + k div 8."""
    return 16 * (number % 8) + number // 8


def decode_header(head: bytes, *, size: int, name: str) -> DaqHeader:
    """Return the header of a channel file, in whichever layout fits its size.

    ``head``: first 12 bytes of the file. ``size``: size of the file in bytes. ``name``: name of the file, for the
    message and, if both layouts fit, for the decision. Raises `RecordError` if neither layout fits; the message names
    the sizes.
    """
    if len(head) < HEADER_BYTES:
        raise RecordError(f"{name}: {size} bytes, too short for a header of {HEADER_BYTES} bytes; acquire it again")
    first, second, third = struct.unpack("<3i", head[:HEADER_BYTES])
    layouts = [(DaqHeader(length=8, frames=first, samples=second), "an earlier SDK")]
    if 0 <= first < CHANNEL_COUNT:
        layouts.insert(0, (DaqHeader(length=12, frames=second, samples=third, channel=first), "SDK 6 and later"))
    possible = [(header, sdk) for header, sdk in layouts if header.frames > 0 and header.samples > 0]
    fitting = [header for header, _ in possible if header.file_bytes == size]
    # Both layouts can fit one size by chance; then the channel in the header must agree with the file's name.
    if len(fitting) == 2 and first != file_number(name):
        return fitting[1]
    if fitting:
        return fitting[0]
    expected = [
        f"{header.file_bytes} bytes by a header of {sdk}" for header, sdk in possible if header.samples <= MAX_SAMPLES
    ]
    if not expected:
        raise RecordError(
            f"{name}: its first bytes are no header of a SonixDAQ channel file (channel, frames, samples; before SDK 6 "
            "frames, samples); it has none, or is no channel file: acquire it again, or save the frame as .npy of "
            "shape (channels, samples)"
        )
    raise RecordError(
        f"{name}: {size} bytes found, expected {', or '.join(expected)}; the file is cut off, still being written, or "
        "no channel file: wait until it is complete, or acquire it again"
    )


def unwritten(data: bytes, *, name: str) -> str:
    """Return why the end of a channel file is not its contents, but zeros that stand for them; empty if it is.

    A network share or a copy gives a file its size before its contents. A channel that is 0 everywhere is dead, and
    whole; so is one whose noise is less than a count, which is 0 nearly everywhere.
    """
    values = np.frombuffer(data[: len(data) // 2 * 2], "<i2")
    written = int(np.max(np.flatnonzero(values), initial=-1)) + 1
    left = len(values) - written
    samples = values[HEADER_BYTES // 2 : written]
    if 2 * left < TAIL_BYTES or not np.count_nonzero(samples) > len(samples) / 2:
        return ""
    return (
        f"{name}: the last {left} of {len(values)} values are 0, its contents have not come yet (a network share or a "
        "copy shows the size of a file first)"
    )


def encode_file(samples: Int16[np.ndarray, "frames samples"], *, number: int | None) -> bytes:
    """Return the channel file with the given pulses.

    With a number in the layout of SDK 6 and later, without in the earlier.
    """
    frames, count = samples.shape
    head = struct.pack("<2i", frames, count) if number is None else struct.pack("<3i", number, frames, count)
    return head + samples.astype("<i2").tobytes()


def decode_samples(body: bytes, header: DaqHeader) -> Int16[np.ndarray, "frames samples"]:
    """Return the samples of a channel file, one row per pulse, from the bytes after the header."""
    # astype without a copy where the computer is little-endian, as nearly all are.
    return np.frombuffer(body, dtype="<i2").reshape(header.frames, header.samples).astype(np.int16, copy=False)


def by_number(names: Iterable[str]) -> dict[int, str]:
    """Return the channel files among these names by their number; `RecordError` if two are of one channel."""
    found: dict[int, str] = {}
    for name in names:
        number = file_number(name)
        if number is None:
            continue
        if number in found:
            raise RecordError(
                f"{found[number]} and {name} are both channel {number}; keep one acquisition per folder, and let one "
                "program of one SDK write there"
            )
        found[number] = name
    return found


def averaged(files: Iterable[tuple[str, bytes]]) -> tuple[Int16[np.ndarray, "channels samples"], int]:
    """Return the samples of all channels by element, averaged over the pulses, and the number of pulses.

    ``files``: name and bytes of each channel file. Raises `RecordError` if they are not all of one acquisition.
    """
    samples = np.empty((CHANNEL_COUNT, 0), np.int16)
    found = 0
    for element, pulses in _channels(files):
        if not found:
            found = len(pulses)
            samples = np.empty((CHANNEL_COUNT, pulses.shape[1]), np.int16)
        samples[element] = mean_of(pulses)
    return samples, found


def mean_of(pulses: Int16[np.ndarray, ...]) -> Int16[np.ndarray, ...]:
    """Return the mean over the first axis, that of the pulses, in whole counts."""
    # In float64: the sum of many int16 pulses overflows int16.
    return np.asarray(np.rint(pulses.mean(axis=0, dtype=np.float64)), np.int16)


def singles(files: Iterable[tuple[str, bytes]], *, pulses: int) -> Int16[np.ndarray, "pulses channels samples"]:
    """Return the samples of each pulse, all channels by element.

    ``files``: as of `averaged`. ``pulses``: how many they must hold. Raises `RecordError` as `averaged`, and if they
    hold another number, or more than `MAX_BURST_BYTES`.
    """
    samples = np.empty((0, CHANNEL_COUNT, 0), np.int16)
    for element, each in _channels(files):
        if len(each) != pulses:
            raise RecordError(
                f"the files hold {len(each)} pulses, {pulses} were triggered: a trigger was lost or doubled, or they "
                "answer another one; check the trigger's cable"
            )
        if not samples.size:
            if not CHANNEL_COUNT * each.nbytes <= MAX_BURST_BYTES:
                raise RecordError(
                    f"the files hold {pulses} pulses of {each.shape[1]} samples, at most {MAX_BURST_BYTES >> 30} GiB "
                    "are read; record a shorter time, or raise receiver.sweep_period_s"
                )
            samples = np.empty((pulses, CHANNEL_COUNT, each.shape[1]), np.int16)
        samples[:, element] = each
    return samples


def _channels(files: Iterable[tuple[str, bytes]]) -> Iterator[tuple[int, Int16[np.ndarray, "frames samples"]]]:
    """Yield the element and pulses of each channel file; `RecordError` if they are not all of one acquisition."""
    first: DaqHeader | None = None
    for name, data in files:
        number = file_number(name)
        header = decode_header(data[:HEADER_BYTES], size=len(data), name=name)
        if header.samples > MAX_SAMPLES:
            raise RecordError(
                f"{name}: it holds {header.samples} samples of each pulse, at most {MAX_SAMPLES} are read; record a "
                "shorter time"
            )
        first = first or header
        # Files of two acquisitions would give a frame whose channels belong to different shots.
        if header != first:
            raise RecordError(
                f"{name}: {header.frames} pulses of {header.samples} samples under a header of {header.length} bytes "
                f"found, {first.frames} of {first.samples} under {first.length} expected as in the files before it; "
                "the folder mixes acquisitions: acquire it again"
            )
        if number is None or header.channel not in (None, number):
            raise RecordError(
                f"{name}: channel {header.channel} is in its header; the files are out of order: acquire again"
            )
        # The connector permutes the channels: file numbers are not element numbers.
        yield element_of_file(number), decode_samples(data[header.length :], header)
