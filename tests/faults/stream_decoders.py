"""The decoder of a stream of events as a function of bytes, for fuzzing."""

from __future__ import annotations

import tempfile
from pathlib import Path

from markerseek.core import Asked, DeviceError, Interval, RecordError, Started
from markerseek.records.stream import EventStream, StreamDecoder, StreamItem
from tests.faults.journal_runs import configuration, measured


def whole_stream() -> bytes:
    """Head, a few events, a frame, and the end."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "events"
        with EventStream(path, configuration(), frames=True) as stream:
            stream.add(Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0)), clock_s=0.0)
            stream.add(Asked(role="search", index=1, angle_deg=0.0), clock_s=0.0)
            stream.add(measured(1, channels=2), clock_s=0.5)
        return path.read_bytes()


def read_stream(data: bytes) -> None:
    """Items do not depend on how the bytes arrive."""
    middle = len(data) // 2
    at_once, refusal = _items(data)
    in_parts, same = _items(data[:middle], data[middle:])
    assert [type(each) for each in at_once] == [type(each) for each in in_parts][: len(at_once)]
    assert (refusal is None) == (same is None)
    if refusal is not None:
        # Refused like the bytes of a device: the other end is a program, too.
        raise DeviceError(str(refusal)) from refusal


def _items(*parts: bytes) -> tuple[list[StreamItem], RecordError | None]:
    decoder, items = StreamDecoder(), list[StreamItem]()
    for part in parts:
        try:
            items += decoder.feed(part)
        except RecordError as problem:
            return items, problem
    return items, None
