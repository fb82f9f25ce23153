"""OpenIGTLink messages as bytes: header, CRC and metadata."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from markerseek.core import ConfigError, DeviceError, is_finite
from markerseek.wire.igtl.contents import EMULATOR, OK, Content, Status
from markerseek.wire.igtl.packing import HEADER_BYTES, character_set, crc, pack, text_of, unpack

_HEADER = struct.Struct(">H12s20sQQQ")
_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")

_MAX_ENTRIES = 64
"""Most entries of metadata that are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """Header of a message."""

    version: int
    """1, or 2 with an extended header and metadata."""
    kind: str
    """Type of the message: "TRANSFORM"."""
    device: str
    """Name of what it describes."""
    time_s: float
    """When it was made, in seconds since 1970; 0 where the sender does not say."""
    body_bytes: int
    """Bytes that follow the header."""
    crc: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Message:
    """One message."""

    device: str
    """Name of what it describes, at most 20 bytes of ASCII."""
    content: Content
    time_s: float = 0.0
    """When it was made, in seconds since 1970."""
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Names and values; header version 1 has no room for them, and they are left out."""
    version: Literal[1, 2] = 2

    def __post_init__(self) -> None:
        if not self.device.isascii() or len(self.device) > 20:
            raise ConfigError(f"device name {self.device!r}: it may have 20 characters of ASCII; shorten it")
        if not (is_finite(self.time_s) and 0 <= self.time_s < 2**32):
            raise ConfigError(f"{self.device}: time_s is {self.time_s} s, it must lie in [0, 2**32) s since 1970")


def encode(message: Message) -> bytes:
    """A message as bytes, with its checksum."""
    body = pack(message.content, version=message.version)
    if message.version > 1:
        index, data = _metadata(message.metadata)
        # No message id: it is for programs that relay messages.
        body = _EXTENDED.pack(_EXTENDED.size, len(index), len(data), 0) + body + index + data
    head = _HEADER.pack(
        message.version,
        message.content.kind.encode("ascii"),
        message.device.encode("ascii"),
        # 32 bits of seconds and 32 bits of their fraction.
        math.floor(message.time_s * 2**32),
        len(body),
        crc(body),
    )
    return head + body


def asks_for_metadata() -> bytes:
    """A message after which a PLUS server sends header version 2, with metadata; it sends version 1 before.

    PlusServer answers each client in the highest version that came from it, and takes a STATUS for a sign of life.
    """
    return encode(Message(device="markerseek", content=Status(code=OK)))


def decode_header(data: bytes, *, most_bytes: int) -> Header:
    """Header of a message, checked before its body is awaited.

    ``data``: the first `HEADER_BYTES` bytes. ``most_bytes``: most bytes that its body may have.
    """
    if len(data) != HEADER_BYTES:
        raise DeviceError(f"OpenIGTLink: a header of {len(data)} bytes, it has {HEADER_BYTES}")
    version, kind, device, stamp, size, crc = _HEADER.unpack(data)
    if version not in (1, 2):
        raise DeviceError(f"OpenIGTLink: header version {version}, known are 1 and 2; this is another protocol")
    if size > most_bytes:
        raise DeviceError(f"OpenIGTLink: a body of {size} bytes, at most {most_bytes} are taken; send less")
    return Header(
        version=version,
        kind=_name(kind, "type"),
        device=_name(device, "device name"),
        time_s=stamp / 2**32,
        body_bytes=size,
        crc=crc,
    )


def decode(header: Header, body: bytes) -> Message:
    """The message with that header and body.

    Raises `DeviceError` if the checksum does not fit, a length is wrong, or a number is not finite; the message says
    which.
    """
    what = f"OpenIGTLink: {header.kind} {header.device!r}"
    if len(body) != header.body_bytes:
        raise DeviceError(f"{what}: {len(body)} bytes came, the header says {header.body_bytes}")
    found = crc(body)
    if found != header.crc:
        raise DeviceError(f"{what}: its CRC is {header.crc:016X}, that of what came is {found:016X}; send it again")
    content, metadata = (body, {}) if header.version == 1 else _without_metadata(body, what)
    try:
        return Message(
            device=header.device,
            content=unpack(header.kind, content),
            time_s=header.time_s,
            metadata=metadata,
            version=1 if header.version == 1 else 2,
        )
    except (ConfigError, UnicodeDecodeError) as problem:
        raise DeviceError(f"{what}: {problem}") from problem


def is_emulated(header: Header, body: bytes) -> bool:
    """Whether a STATUS says that its server is an emulator; errors as of `decode`."""
    said = decode(header, body).content
    return isinstance(said, Status) and said.message == EMULATOR


class Framer:
    """Splits a stream of bytes into messages, not decoded yet.

    ``most_bytes``: most bytes that the body of a message may have.
    """

    def __init__(self, *, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._received = bytearray()
        self._header: Header | None = None

    @property
    def incomplete(self) -> bool:
        """Whether a message has begun whose rest has not come."""
        return bool(self._received) or self._header is not None

    def feed(self, data: bytes) -> Iterator[tuple[Header, bytes]]:
        """Header and body of each message that is complete with these bytes; errors as of `decode_header`."""
        self._received += data
        while True:
            if self._header is None:
                if len(self._received) < HEADER_BYTES:
                    return
                # Its length is limited here, before the body is awaited.
                self._header = decode_header(self._taken(HEADER_BYTES), most_bytes=self._most_bytes)
            if len(self._received) < self._header.body_bytes:
                return
            header, self._header = self._header, None
            yield header, self._taken(header.body_bytes)

    def _taken(self, size: int) -> bytes:
        taken = bytes(self._received[:size])
        del self._received[:size]
        return taken


def _name(field_: bytes, what: str) -> str:
    name = field_.rstrip(b"\0 ")
    if not (name.isascii() and all(32 <= byte < 127 for byte in name)):
        raise DeviceError(f"OpenIGTLink: its {what} {name!r} is no text; this is another protocol")
    return name.decode("ascii")


def _metadata(values: Mapping[str, str]) -> tuple[bytes, bytes]:
    """Table of contents of the metadata, and the metadata."""
    index, data = struct.pack(">H", len(values)), b""
    for key, value in values.items():
        one, other = key.encode(), value.encode()
        index += _ENTRY.pack(len(one), character_set(value), len(other))
        data += one + other
    return index, data


def _without_metadata(body: bytes, what: str) -> tuple[bytes, dict[str, str]]:
    """Content and metadata of a body with an extended header."""
    if len(body) < _EXTENDED.size:
        raise DeviceError(f"{what}: {len(body)} bytes are too few for an extended header")
    start, index_bytes, data_bytes, _ = _EXTENDED.unpack_from(body)
    end = len(body) - index_bytes - data_bytes
    if not _EXTENDED.size <= start <= end:
        raise DeviceError(f"{what}: extended header and metadata are longer than its body")
    if index_bytes == 0:
        return body[start:end], {}
    index, data = body[end : end + index_bytes], body[end + index_bytes :]
    count = int.from_bytes(index[:2], "big")
    if count > _MAX_ENTRIES or len(index) != 2 + _ENTRY.size * count:
        raise DeviceError(f"{what}: {count} entries of metadata in {len(index)} bytes; at most {_MAX_ENTRIES} are read")
    metadata, at = {}, 0
    for key_bytes, number, value_bytes in _ENTRY.iter_unpack(index[2:]):
        after = at + key_bytes + value_bytes
        if after > len(data):
            raise DeviceError(f"{what}: its metadata are longer than their space")
        try:
            key = data[at : at + key_bytes].decode()
            metadata[key] = text_of(data[at + key_bytes : after], number)
        except (UnicodeDecodeError, ConfigError) as problem:
            raise DeviceError(f"{what}: its metadata are no text: {problem}") from problem
        at = after
    return body[start:end], metadata
