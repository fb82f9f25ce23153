"""Decodes a stream of events as it arrives: bytes in, typed events out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import msgspec

from markerseek.core import FrameHeader, Measured, RecordError, Sample
from markerseek.records.configuration import Configuration
from markerseek.records.journal.encoding import decode
from markerseek.records.journal.events import JournalEvent
from markerseek.records.stream.lines import VERSION, EventLine

MAX_LINE_BYTES = 1 << 22
"""Longest line: the configuration with the angles of a recorded scan has some hundred kilobytes."""

MAX_FRAME_BYTES = 1 << 26
"""Largest frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamHead:
    """The run begins."""

    configuration: Configuration
    """Plan of the search, facts of the rig, versions."""
    frames: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamEvent:
    """One event, which is committed to the journal where the run keeps one."""

    number: int
    written: str
    clock_s: float
    event: JournalEvent
    """``number``, ``written``, ``clock_s`` and ``event``: as in an entry of a journal. The event has its frame only if
    its data were sent."""
    header: FrameHeader | None
    """Header of its frame, also where the data were not sent; None where it has no frame."""
    lost_lines: int
    lost_frames: int
    """``lost_lines`` and ``lost_frames``: what was lost just before, because this program read too slowly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamEnd:
    """The run is over, or was stopped; without this its process was killed."""

    lost_lines: int = 0
    lost_frames: int = 0


StreamItem: TypeAlias = StreamHead | StreamEvent | StreamEnd
"""Whatever a stream holds."""


class StreamDecoder:
    """Decodes one stream, piece by piece."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._line: EventLine | None = None
        self._confirmation: Sample | None = None
        self._begun = False

    def feed(self, data: bytes) -> list[StreamItem]:
        """Everything that is complete with these bytes.

        ``data``: the next bytes of the stream, cut anywhere.
        """
        self._bytes += data
        items: list[StreamItem] = []
        while (item := self._next()) is not None:
            items.append(item)
        return items

    def _next(self) -> StreamItem | None:
        if self._line is None:
            end = self._bytes.find(b"\n")
            if end < 0:
                if len(self._bytes) > MAX_LINE_BYTES:
                    raise RecordError(f"stream: a line of more than {MAX_LINE_BYTES} bytes; this is no event stream")
                return None
            text = bytes(self._bytes[:end])
            del self._bytes[: end + 1]
            item = self._item(text)
            if item is not None:
                return item
        return self._with_frame()

    def _item(self, text: bytes) -> StreamItem | None:
        """What a line holds; None if a frame may follow it."""
        try:
            if not self._begun:
                return self._head(text)
            if text.startswith(b'{"end"'):
                return msgspec.json.decode(text, type=StreamEnd)
            self._line = msgspec.json.decode(text, type=EventLine)
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            raise RecordError(f"stream: a line cannot be read: {problem}") from problem
        if not 0 <= self._line.frame_bytes <= MAX_FRAME_BYTES:
            raise RecordError(f"stream: a frame of {self._line.frame_bytes} bytes, at most {MAX_FRAME_BYTES} expected")
        return None

    def _head(self, text: bytes) -> StreamHead:
        version = msgspec.json.decode(text, type=_Version).stream
        if version != VERSION:
            raise RecordError(f"stream: version {version}, this program reads version {VERSION}; update it")
        head = msgspec.json.decode(text, type=StreamHead)
        self._begun = True
        return head

    def _with_frame(self) -> StreamEvent | None:
        """The event of the last line, once its frame has arrived."""
        line = self._line
        if line is None or len(self._bytes) < line.frame_bytes:
            return None
        samples = bytes(self._bytes[: line.frame_bytes]) if line.frame_bytes else None
        del self._bytes[: line.frame_bytes]
        self._line = None
        body, header = _split(line.kind, bytes(line.body), keep_frame=samples is not None)
        event = decode(line.kind, body, samples, confirmation=self._confirmation)
        if isinstance(event, Measured) and event.role == "confirmation":
            # `Finished` is sent without its confirmation, which is this sample.
            self._confirmation = event.sample
        return StreamEvent(
            number=line.number,
            written=line.written,
            clock_s=line.clock_s,
            event=event,
            header=header,
            lost_lines=line.lost_lines,
            lost_frames=line.lost_frames,
        )


class _Version(msgspec.Struct, frozen=True):
    stream: int


def _split(kind: str, body: bytes, *, keep_frame: bool) -> tuple[bytes, FrameHeader | None]:
    """Body of an event, without a frame whose arrays were not sent, and the header of its frame."""
    try:
        values: Any = msgspec.json.decode(body)
        holder = values["sample"] if kind == "measured" else values
        frame = holder.get("frame")
        if frame is None:
            return body, None
        header = msgspec.convert(frame["header"], FrameHeader)
        if keep_frame or frame.get("type") == "ReadingFrame":
            return body, header
        holder["frame"] = None
        return msgspec.json.encode(values), header
    except (msgspec.MsgspecError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as problem:
        raise RecordError(f"stream: an event of the kind {kind[:40]!r} cannot be read: {problem}") from problem
