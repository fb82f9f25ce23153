"""The stream of a run's events for programs that watch it: one JSON line per event, frames as blocks on request.

`EventStream` writes it and never waits for its reader; `StreamDecoder` turns its bytes back into events.
"""

from markerseek.records.stream.decoder import StreamDecoder, StreamEnd, StreamEvent, StreamHead, StreamItem
from markerseek.records.stream.writer import EventStream

__all__ = ["EventStream", "StreamDecoder", "StreamEnd", "StreamEvent", "StreamHead", "StreamItem"]
