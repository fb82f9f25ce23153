"""Lines of a stream of events: the head with the configuration, one line per event, and the end.

The first line has ``stream``, the version of the format, ``frames``, whether frames are sent, and ``configuration``.
A line of an event has the keys of an entry of ``markerseek journal show --json``. Where ``frame_bytes`` is given, as
many bytes follow the line: the ADC counts of its frame, little-endian int16, channel after channel, and behind them the
grey values of its B-mode image, row after row, where the body has a ``b_mode``. ``lost_lines`` and ``lost_frames``
count what was lost since the line before, because the reader was too slow.
"""

from __future__ import annotations

import msgspec

VERSION = 1
"""Version of the format, in the head."""


class EventLine(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One event; the first five keys are those of an entry of a journal."""

    number: int
    kind: str
    written: str
    clock_s: float
    body: msgspec.Raw
    frame_bytes: int = 0
    lost_lines: int = 0
    lost_frames: int = 0


class EndLine(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The last line; it is missing if the process was killed."""

    end: bool
    lost_lines: int = 0
    lost_frames: int = 0


def encoded(line: EventLine | EndLine | dict[str, object]) -> bytes:
    """A line as bytes, with its line feed."""
    # The recipe in a foreign journal may be written over several lines; inside a JSON text a line feed is an escape.
    return msgspec.json.encode(line).replace(b"\n", b" ") + b"\n"
