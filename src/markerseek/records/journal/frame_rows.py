"""Frames as rows: a JSON body, and beside it the samples as they are."""

from __future__ import annotations

from typing import TypeAlias

import msgspec
import numpy as np

from markerseek.core import ChannelFrame, Frame, FrameHeader, ReadingFrame, RecordError
from markerseek.records.journal.plain import plain


class ChannelFrameBody(msgspec.Struct, frozen=True, kw_only=True, tag="channels"):
    """The samples themselves are a blob of little-endian int16, channel after channel."""

    header: FrameHeader
    sampling_hz: float
    shape: tuple[int, int]


class ReadingFrameBody(msgspec.Struct, frozen=True, kw_only=True, tag="reading"):
    """A frame that is one number."""

    header: FrameHeader
    intensity: float
    noise_sigma: float | None
    cells: int | None


FrameBody: TypeAlias = ChannelFrameBody | ReadingFrameBody
"""Either of them."""


def frame_body(frame: Frame) -> FrameBody:
    """Body of a frame."""
    if isinstance(frame, ChannelFrame):
        return channel_body(frame)
    return ReadingFrameBody(
        header=frame.header, intensity=frame.intensity, noise_sigma=frame.noise_sigma, cells=frame.cells
    )


def channel_body(frame: ChannelFrame) -> ChannelFrameBody:
    """Body of a frame of channel data."""
    channels, samples = frame.samples.shape
    return ChannelFrameBody(header=frame.header, sampling_hz=frame.sampling_hz, shape=(channels, samples))


def is_exact(frame: Frame) -> bool:
    """Whether JSON holds all numbers of a frame but its counts."""
    try:
        plain(frame_body(frame), what="a frame")
    except RecordError:
        return False
    return True


def counts_of(frame: ChannelFrame) -> memoryview:
    """Samples as little-endian int16, channel after channel."""
    return np.ascontiguousarray(frame.samples, dtype="<i2").data.cast("B")


def frame_of(body: FrameBody, samples: bytes | memoryview | None) -> Frame:
    """Frame of a body; errors as of `channels_of`."""
    if isinstance(body, ReadingFrameBody):
        return ReadingFrame(
            header=body.header, intensity=body.intensity, noise_sigma=body.noise_sigma, cells=body.cells
        )
    return channels_of(body, samples)


def channels_of(body: ChannelFrameBody, samples: bytes | memoryview | None) -> ChannelFrame:
    """Frame of a body and its samples; `RecordError` if they do not belong together."""
    channels, length = body.shape
    if samples is None or channels < 1 or length < 1 or len(samples) != 2 * channels * length:
        held = 0 if samples is None else len(samples)
        raise RecordError(f"a frame of {channels} channels and {length} samples with {held} bytes")
    counts = np.frombuffer(samples, dtype="<i2").reshape(channels, length).astype(np.int16, copy=False)
    try:
        return ChannelFrame(header=body.header, samples=counts, sampling_hz=body.sampling_hz)
    except ValueError as problem:
        raise RecordError(f"a frame that is none: {problem}") from problem
