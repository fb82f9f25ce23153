"""The lines of a journal: one JSON line an entry, and behind it the raw samples of its frame.

A line begins with five numbers of fixed width: its number, the bytes of the rest of the line, those of the frame behind
it, and two checksums. The rest has the keys ``kind``, ``written``, ``clock_s``, ``body`` and ``checkpoint``; line 0
has ``journal``, the version of this format, and ``configuration``. A frame is followed by a line feed.

``check`` is the CRC-32 of the first three numbers, ``crc`` that of the rest and the frame; each goes on from the sum
before it, so that the lines form a chain. The lengths have a sum of their own: an entry that is shorter than they say
is one that was never finished, and any flipped bit is damage.
"""

from __future__ import annotations

import os
import zlib
from pathlib import Path

import msgspec

from markerseek.core import Measured, RecordError, Sample
from markerseek.records.configuration import Configuration
from markerseek.records.journal.encoding import decode, encode, json_values, require_finite
from markerseek.records.journal.events import Entry
from markerseek.records.journal.file import MAGIC

VERSION = 1
"""Version of the format; newer ones are refused."""

MAX_LINE_BYTES = 1 << 24
"""Longest line: the configuration with the angles of a recorded scan has some hundred kilobytes."""

MAX_FRAME_BYTES = 1 << 28
"""Largest frame."""

_LENGTHS = b'{"number":%8d,"bytes":%9d,"frame_bytes":%9d,'
_SUMS = b'"check":%10d,"crc":%10d,'
_LENGTHS_BYTES = len(_LENGTHS % (0, 0, 0))
PREFIX_BYTES = _LENGTHS_BYTES + len(_SUMS % (0, 0))
"""Bytes of the five numbers with their names."""


class _First(msgspec.Struct, frozen=True):
    journal: int
    configuration: msgspec.Raw


class _Line(msgspec.Struct, frozen=True):
    kind: str
    written: str
    clock_s: float
    body: msgspec.Raw
    checkpoint: msgspec.Raw


def first_line(configuration: Configuration) -> tuple[bytes, int]:
    """Line 0 and its checksum."""
    as_json = msgspec.json.encode(json_values(configuration, what="the configuration"))
    try:
        # msgspec checks value ranges only on decoding, and a written journal must be readable.
        msgspec.json.decode(as_json, type=Configuration)
    except msgspec.ValidationError as problem:
        raise RecordError(f"the configuration cannot be recorded: {problem}") from problem
    # A recipe may be written over several lines; inside a JSON text a line feed is an escape.
    held = _First(journal=VERSION, configuration=msgspec.Raw(as_json.replace(b"\n", b" ")))
    return _chained(0, msgspec.json.encode(held), b"", previous=0)


def entry_line(entry: Entry, *, previous: int) -> tuple[bytes, int]:
    """Bytes of an entry, and its checksum; `RecordError` if JSON cannot hold it exactly."""
    encoded = encode(entry.event)
    line = _Line(
        kind=encoded.kind,
        written=entry.written,
        clock_s=require_finite(float(entry.clock_s), what="the rig's clock"),
        body=msgspec.Raw(encoded.body),
        checkpoint=msgspec.Raw(b"null" if entry.checkpoint is None else entry.checkpoint.replace(b"\n", b" ")),
    )
    return _chained(entry.number, msgspec.json.encode(line), encoded.samples or b"", previous=previous)


def _chained(number: int, held: bytes, frame: bytes | memoryview, *, previous: int) -> tuple[bytes, int]:
    # Without its opening brace, which the prefix has.
    rest = held[1:] + b"\n"
    if len(rest) > MAX_LINE_BYTES or len(frame) > MAX_FRAME_BYTES:
        raise RecordError(
            f"entry {number}: {len(rest)} bytes and a frame of {len(frame)} cannot be recorded, at most "
            f"{MAX_LINE_BYTES} and {MAX_FRAME_BYTES}"
        )
    lengths = _LENGTHS % (number, len(rest), len(frame))
    check = zlib.crc32(lengths, previous)
    own = zlib.crc32(frame, zlib.crc32(rest, check))
    return b"".join((lengths, _SUMS % (check, own), rest, frame, b"\n" if frame else b"")), own


class EntryReader:
    """Reads the entries of an open journal in order, also while it is written; `RecordError` at the first damage.

    ``descriptor``: of the file, which stays open.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self.end = 0
        """Bytes of the entries that have been read."""
        self.checksum = 0
        """Checksum of the last of them."""
        self.descriptor = descriptor
        self._number = 0
        self._confirmation: Sample | None = None
        self.configuration = self._configuration()

    def next(self) -> Entry | None:
        """The next entry; None where the file ends, or holds an entry that was never finished."""
        found = self._next_line()
        if found is None:
            return None
        rest, frame = found
        number = self._number
        try:
            line = msgspec.json.decode(b"{" + rest, type=_Line)
            event = decode(line.kind, bytes(line.body), frame or None, confirmation=self._confirmation)
        except RecordError as problem:
            raise RecordError(f"{self.path}: entry {number} is {problem}") from problem
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            raise RecordError(f"{self.path}: entry {number} cannot be read: {problem}; it is foreign") from problem
        if isinstance(event, Measured) and event.role == "confirmation":
            # `Finished` is stored without its confirmation, which is this sample.
            self._confirmation = event.sample
        self._number += 1
        return Entry(
            number=number,
            written=line.written,
            clock_s=line.clock_s,
            event=event,
            checkpoint=None if bytes(line.checkpoint) == b"null" else bytes(line.checkpoint),
        )

    def _configuration(self) -> Configuration:
        head = os.pread(self.descriptor, PREFIX_BYTES, 0)
        if not head:
            raise RecordError(
                f"{self.path}: it is empty: no journal of a run (or its run was never begun); check the name"
            )
        if not head.startswith(MAGIC):
            raise RecordError(
                f"{self.path}: it does not begin as a journal does, so that it is another kind of file, or damaged, "
                "or from before the first release; check the name ('markerseek replay' searches recorded scans)"
            )
        found = self._next_line()
        if found is None:
            raise RecordError(f"{self.path}: it ends in its first line: its run was never begun; begin a new search")
        try:
            first = msgspec.json.decode(b"{" + found[0], type=_First)
            if first.journal > VERSION:
                raise RecordError(
                    f"{self.path}: it was written by a newer markerseek: the journal has version {first.journal}, this "
                    f"one reads up to {VERSION}; install a newer one"
                )
            configuration = msgspec.json.decode(first.configuration, type=Configuration)
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            # Its checksum agrees, so that it is not damaged.
            raise RecordError(
                f"{self.path}: the configuration cannot be read: {problem}; another version of markerseek wrote it: "
                "use that one"
            ) from problem
        self._number = 1
        return configuration

    def _next_line(self) -> tuple[bytes, bytes] | None:
        """Rest of the next line and its frame, once both agree with their checksums; None where they are missing."""
        prefix = os.pread(self.descriptor, PREFIX_BYTES, self.end)
        if len(prefix) < PREFIX_BYTES or (prefix.endswith(b"\0") and self._is_unwritten(self.end + PREFIX_BYTES)):
            return None
        numbers = _numbers(prefix)
        if numbers is None or zlib.crc32(prefix[:_LENGTHS_BYTES], self.checksum) != numbers[3]:
            self._require_changed(prefix, "the lengths do not agree with their checksum")
            return None
        number, rest_bytes, frame_bytes, check, own = numbers
        if number != self._number:
            raise RecordError(f"{self._here} is missing, entry {number} follows; the journal is damaged")
        if rest_bytes > MAX_LINE_BYTES or frame_bytes > MAX_FRAME_BYTES:
            raise RecordError(f"{self._here} has {rest_bytes} bytes and a frame of {frame_bytes}; it is foreign")
        size = rest_bytes + frame_bytes + (frame_bytes > 0)
        data = os.pread(self.descriptor, size, self.end + PREFIX_BYTES)
        # A loss of power can leave the end of the last entry as zeros; each entry ends in a line feed.
        if len(data) < size or (data.endswith(b"\0") and self._is_unwritten(self.end + PREFIX_BYTES + size)):
            return None
        if zlib.crc32(data[: rest_bytes + frame_bytes], check) != own or data[-1:] != b"\n":
            self._require_changed(prefix, "it does not agree with its checksum")
            return None
        self.end += PREFIX_BYTES + size
        self.checksum = own
        return data[:rest_bytes], data[rest_bytes : rest_bytes + frame_bytes]

    def _is_unwritten(self, place: int) -> bool:
        """Whether there are only zeros from here to the end of the file."""
        while piece := os.pread(self.descriptor, 1 << 20, place):
            if piece.strip(b"\0"):
                return False
            place += len(piece)
        return True

    def _require_changed(self, prefix: bytes, reason: str) -> None:
        """`RecordError`, unless the writer has cut an unfinished entry off and writes another in its place."""
        if os.pread(self.descriptor, PREFIX_BYTES, self.end) == prefix:
            raise RecordError(f"{self._here}: {reason}; it is damaged")

    @property
    def _here(self) -> str:
        return f"{self.path}: " + ("the configuration" if self._number == 0 else f"entry {self._number}")


def _numbers(prefix: bytes) -> tuple[int, int, int, int, int] | None:
    """The five numbers of a prefix; None where it is none."""
    try:
        fields = [int(each.rpartition(b":")[2]) for each in prefix.rstrip(b",").split(b",")]
        number, rest_bytes, frame_bytes, check, own = fields
    except ValueError:
        return None
    if min(fields) < 0 or prefix != _LENGTHS % (number, rest_bytes, frame_bytes) + _SUMS % (check, own):
        return None
    return number, rest_bytes, frame_bytes, check, own
