"""The entries of a record, as bytes: a line of JSON, and behind it the raw samples of its frame, if it has one.

A line begins with ``{"crc":"`` and the CRC-32 of the rest of the line, as eight hexadecimal digits. The rest of an
entry has the keys ``number``, ``block`` (bytes of the frame behind the line, 0 without one), ``block_crc``, ``kind``,
``written``, ``clock_s`` and ``body``; the rest of line 0 has ``record``, the version of this format, and
``configuration``. A frame is followed by a line feed.
"""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import TypeVar

import msgspec

from markerseek.core import Measured, RecordError, Sample
from markerseek.records.journal.entries import (
    Configuration,
    JournalEntry,
    StoredEntry,
    as_json,
    decode_entry,
    encode_entry,
)
from markerseek.records.journal.file import MAGIC, MAGIC_1

FORMAT_VERSION = 2
"""Version of the format; newer ones are refused."""

MAX_LINE_BYTES = 1 << 24
"""Longest line: the configuration with the angles of a recorded scan has some hundred kilobytes."""

MAX_FRAME_BYTES = 1 << 28
"""Largest frame."""

_PREFIX_BYTES = len(MAGIC) + len('00000000",')
_PIECE_BYTES = 1 << 16

_PREFIX_1 = re.compile(
    rb'\{"number": *(\d+),"bytes": *(\d+),"frame_bytes": *(\d+),"check": *(\d+),"crc": *(\d+),', re.ASCII
)
_PREFIX_1_BYTES = len(b'{"number":%8d,"bytes":%9d,"frame_bytes":%9d,"check":%10d,"crc":%10d,' % (0, 0, 0, 0, 0))
"""Beginning of a line in files of version 1: number, bytes of the rest and of the frame behind it, CRC-32 of these
three, and that of the rest and the frame, which goes on from it."""


class UnfinishedError(RecordError):
    """A journal without its first line: its run was never begun."""


def _with_flat_tolerance(configuration: msgspec.Raw) -> bytes:
    """Return a configuration as it is written now: version 0.3 had one value for both tolerances of the plan."""
    match msgspec.json.decode(configuration):
        case {"plan": {"tolerance": dict() as tolerance, **plan}} as values:
            plan |= {f"tolerance_{unit}": value for unit, value in tolerance.items()}
            return msgspec.json.encode(values | {"plan": plan})
        case _:
            return bytes(configuration)


_NOTHING = msgspec.Raw(b"null")


class FirstLine(msgspec.Struct, frozen=True, kw_only=True):
    """Line 0: the configuration, or what a session registers, and the version of the format."""

    configuration: msgspec.Raw = _NOTHING
    begun: msgspec.Raw = _NOTHING
    record: int = 0
    """Version of the format of a journal, from 2 on."""
    session: int = 0
    """Version of the format of the record of a session."""
    following: int = 0
    """Version of the format of the record of a run that follows."""
    journal: int = 0
    """Version of the format in files of version 1."""


_Kind = TypeVar("_Kind", StoredEntry, FirstLine)


def first_line(configuration: Configuration) -> bytes:
    """Return line 0."""
    encoded = as_json(configuration, what="the configuration")
    try:
        # msgspec checks value ranges only on decoding, and a written journal must be readable.
        msgspec.json.decode(encoded, type=Configuration)
    except msgspec.ValidationError as problem:
        raise RecordError(f"the configuration cannot be recorded: {problem}") from problem
    return line_of({"record": FORMAT_VERSION, "configuration": msgspec.Raw(encoded)})


def entry_line(entry: JournalEntry) -> bytes:
    """Return the bytes of an entry; `RecordError` if JSON cannot hold it exactly."""
    line, samples = encode_entry(entry)
    if line.block > MAX_FRAME_BYTES:
        raise RecordError(
            f"entry {entry.number}: a frame of {line.block} bytes, at most {MAX_FRAME_BYTES} are recorded"
        )
    return b"".join((line_of(line), samples, b"\n" if line.block else b""))


def line_of(value: object) -> bytes:
    """Return a value as a line with its check sum; `RecordError` if it is too long."""
    # A recipe may be JSON over several lines; inside a JSON text a line feed is escaped.
    rest = msgspec.json.encode(value)[1:].replace(b"\n", b" ") + b"\n"
    if len(rest) > MAX_LINE_BYTES:
        raise RecordError(f"an entry of {len(rest)} bytes cannot be recorded, at most {MAX_LINE_BYTES}")
    return MAGIC + b'%08x",' % zlib.crc32(rest) + rest


class LineReader:
    """Reads the lines of an open file in order, also while it is written; `RecordError` at the first damage.

    ``descriptor``: descriptor of the file, which stays open.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        self.path = path
        self.end = 0
        """Bytes of the lines that have been read."""
        self.descriptor = descriptor
        self._number = 0

    def _next_first(self) -> FirstLine | None:
        """Return the first line, once it agrees with its checksum; None if it is missing."""
        line = self._next_bytes()
        if line is None:
            return None
        found = self._decoded(line[_PREFIX_BYTES:], FirstLine)
        self.end += len(line)
        return found

    def _next_bytes(self) -> bytes | None:
        """Return the next line, once it agrees with its checksum; None if it is missing."""
        line = b""
        while b"\n" not in line[-_PIECE_BYTES:]:
            piece = os.pread(self.descriptor, _PIECE_BYTES, self.end + len(line))
            line += piece
            if len(line) > MAX_LINE_BYTES + _PIECE_BYTES:
                raise RecordError(f"{self._here} has a line of more than {MAX_LINE_BYTES} bytes; it is damaged")
            if not piece:
                if self._agrees(line[:-1] + b"\n"):
                    raise RecordError(f"{self._here}: its last byte is not a line feed; it is damaged")
                return None
        line = line[: line.index(b"\n") + 1]
        if not self._agrees(line):
            self._require_changed(line, "its line does not agree with its checksum")
            return None
        return line

    def _next_line(self) -> tuple[StoredEntry, bytes] | None:
        """Return the next entry and its samples, once both agree with their checksums; None if they are missing."""
        line = self._next_bytes()
        if line is None:
            return None
        found = self._decoded(line[_PREFIX_BYTES:], StoredEntry)
        if not 0 <= found.block <= MAX_FRAME_BYTES:
            raise RecordError(f"{self._here} has a frame of {found.block} bytes; it is foreign")
        size = found.block + (found.block > 0)
        data = os.pread(self.descriptor, size, self.end + len(line))
        whole = len(data) == size and (not size or data[-1:] == b"\n")
        if size and not (whole and f"{zlib.crc32(data[:-1]):08x}" == found.block_crc):
            # A loss of power can leave the end of the last entry missing, or zero.
            is_last = os.fstat(self.descriptor).st_size <= self.end + len(line) + size
            if len(data) < size or (data[-1:] == b"\0" and is_last):
                return None
            self._require_changed(line, "its frame does not agree with its checksum")
            return None
        self.end += len(line) + size
        return found, data[:-1]

    def _decoded(self, rest: bytes, kind: type[_Kind]) -> _Kind:
        try:
            return msgspec.json.decode(b"{" + rest, type=kind)
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            raise RecordError(f"{self._here} cannot be read: {problem}; it is foreign") from problem

    @staticmethod
    def _agrees(line: bytes) -> bool:
        """Return whether a line agrees with its checksum."""
        return line[:_PREFIX_BYTES] == MAGIC + b'%08x",' % zlib.crc32(line[_PREFIX_BYTES:])

    def _require_changed(self, line: bytes, reason: str) -> None:
        """`RecordError`, unless the writer has cut an unfinished entry off and writes another in its place."""
        if os.pread(self.descriptor, len(line), self.end) == line:
            raise RecordError(f"{self._here}: {reason}; it is damaged")

    @property
    def _here(self) -> str:
        return f"{self.path}: " + ("the first line" if self._number == 0 else f"entry {self._number}")


class EntryReader(LineReader):
    """Reads the entries of an open record in order, also while it is written; `RecordError` at the first damage.

    ``descriptor``: descriptor of the file, which stays open.
    """

    def __init__(self, path: Path, descriptor: int) -> None:
        super().__init__(path, descriptor)
        self.version = FORMAT_VERSION
        """Version of the file's format."""
        self._confirmation: Sample | None = None
        self.configuration = self._configuration()

    def next(self) -> JournalEntry | None:
        """Return the next entry; None if the file ends, or holds an entry that was never finished."""
        found = self._next_line_1() if self.version == 1 else self._next_line()
        if found is None:
            return None
        line, frame = found
        number = self._number
        try:
            event = decode_entry(line, frame, confirmation=self._confirmation)
        except RecordError as problem:
            raise RecordError(f"{self.path}: entry {number} is {problem}") from problem
        if self.version > 1 and line.number != number:
            raise RecordError(f"{self._here} is missing, entry {line.number} follows; the journal is damaged")
        if isinstance(event, Measured) and event.role == "confirmation":
            # `Finished` is stored without its confirmation, which is this sample.
            self._confirmation = event.sample
        self._number += 1
        return JournalEntry(number=number, written=line.written, clock_s=line.clock_s, event=event)

    def _configuration(self) -> Configuration:
        head = os.pread(self.descriptor, len(MAGIC_1), 0)
        if not head:
            raise UnfinishedError(
                f"{self.path}: it is empty: no journal of a run (or its run was never begun); check the name"
            )
        self.version = 1 if head == MAGIC_1 else FORMAT_VERSION
        if self.version != 1 and not head.startswith(MAGIC):
            raise RecordError(
                f"{self.path}: it does not begin as a journal does, so that it is another kind of file, or damaged, "
                "or from before the first release; check the name (`replayed()` searches recorded scans)"
            )
        first = self._next_first_1() if self.version == 1 else self._next_first()
        if first is None:
            raise UnfinishedError(
                f"{self.path}: it ends in its first line: its run was never begun; begin a new search"
            )
        if first.session:
            raise RecordError(
                f"{self.path}: it is the record of a registration session; name the journal of a search in its folder"
            )
        version = max(first.record, first.journal)
        if version > FORMAT_VERSION:
            raise RecordError(
                f"{self.path}: it was written by a newer markerseek: the journal has version {version}, this one "
                f"reads up to {FORMAT_VERSION}; install a newer one"
            )
        try:
            configuration = msgspec.json.decode(_with_flat_tolerance(first.configuration), type=Configuration)
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            # Its checksum agrees, so it is not damaged.
            raise RecordError(
                f"{self.path}: the configuration cannot be read: {problem}; another version of markerseek wrote it: "
                "use that one"
            ) from problem
        self._number = 1
        return configuration

    def _next_line_1(self) -> tuple[StoredEntry, bytes] | None:
        """`_next_line` of a file of version 1."""
        found = self._next_bytes_1()
        return None if found is None else (self._decoded(found[0], StoredEntry), found[1])

    def _next_first_1(self) -> FirstLine | None:
        """`_next_first` of a file of version 1."""
        found = self._next_bytes_1()
        return None if found is None else self._decoded(found[0], FirstLine)

    def _next_bytes_1(self) -> tuple[bytes, bytes] | None:
        """Return the next line of a file of version 1 without its prefix, and the samples behind it."""
        prefix = os.pread(self.descriptor, _PREFIX_1_BYTES, self.end)
        if len(prefix) < _PREFIX_1_BYTES:
            return None
        match = _PREFIX_1.fullmatch(prefix)
        number, rest_bytes, frame_bytes, check, own = map(int, match.groups()) if match else (-1, 0, 0, 0, 0)
        if number != self._number or rest_bytes > MAX_LINE_BYTES or frame_bytes > MAX_FRAME_BYTES:
            raise RecordError(f"{self._here}: it does not begin as an entry does; it is damaged")
        size = rest_bytes + frame_bytes + (frame_bytes > 0)
        data = os.pread(self.descriptor, size, self.end + _PREFIX_1_BYTES)
        if len(data) < size:
            return None
        if zlib.crc32(data[: rest_bytes + frame_bytes], check) != own or data[-1:] != b"\n":
            raise RecordError(f"{self._here}: it does not agree with its checksum; it is damaged")
        self.end += _PREFIX_1_BYTES + size
        return data[:rest_bytes], data[rest_bytes : rest_bytes + frame_bytes]

    @property
    def _here(self) -> str:
        return f"{self.path}: " + ("the configuration" if self._number == 0 else f"entry {self._number}")
