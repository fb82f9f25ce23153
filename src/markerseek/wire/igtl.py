"""OpenIGTLink messages as bytes: header, CRC, metadata (header version 2) and contents, packed and checked.

TRANSFORM, IMAGE and POINT are packed and unpacked by pyigtl. The rest is here: pyigtl checks no CRC and no length, cuts
names off in silence, cannot send a text that is not ASCII, has 152 bytes for a POSITION where the standard has 28, and
has no STATUS and no COMMAND. All numbers are big-endian (http://openigtlink.org/developers/spec).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np

from markerseek.core import ConfigError, DeviceError, Float64, is_finite, is_whole, needs_package

MAX_TEXT_BYTES = 0xFFFF
"""Longest text of a STRING, whose length is a 16-bit number; used for a COMMAND too."""

COMMAND_NAME_BYTES = 128
"""Longest name of a COMMAND."""

STATUS_NAME_BYTES = 20
"""Longest name of a STATUS."""

EMULATOR = "simulated by markerseek"
"""What an emulated server says of itself in a STATUS, and in the metadata ``emulator`` of its images."""

OK = 1
UNKNOWN_ERROR = 2
BUSY = 6
NOT_READY = 13
"""Codes of a STATUS."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Transform:
    """TRANSFORM: a rigid or affine transform, or None."""

    kind: ClassVar[str] = "TRANSFORM"
    matrix: Float64[np.ndarray, "4 4"] | None
    """4 x 4, the last row (0, 0, 0, 1); None: sent as NaN."""

    def __post_init__(self) -> None:
        if self.matrix is not None:
            _require_matrix(self.kind, self.matrix)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Image:
    """IMAGE with one number per pixel."""

    kind: ClassVar[str] = "IMAGE"
    pixels: np.ndarray
    """Shape (slices, rows, columns): int8, uint8, int16, uint16, int32, uint32, float32 or float64."""
    matrix: Float64[np.ndarray, "4 4"]
    """4 x 4: from (column, row, slice, 1) to the world, in millimetres."""
    system: str = "ras"
    """Axes of the world. 3D Slicer takes RAS, whatever is named here."""

    def __post_init__(self) -> None:
        _require_matrix(self.kind, self.matrix)
        if self.pixels.ndim != 3 or not all(0 < size <= 0xFFFF for size in self.pixels.shape):
            raise ConfigError(
                f"IMAGE: pixels have the shape {self.pixels.shape}, it must be (slices, rows, columns), each from 1 to "
                "65535"
            )
        if self.pixels.dtype.newbyteorder("=") not in SCALARS.values():
            raise ConfigError(f"IMAGE: pixels are {self.pixels.dtype}; convert them to uint8, int16 or float32")
        if self.system not in ("ras", "lps"):
            raise ConfigError(f"IMAGE: system is {self.system!r}, it must be ras or lps")


SCALARS = {
    number: np.dtype(name)
    for number, name in (
        (2, "int8"),
        (3, "uint8"),
        (4, "int16"),
        (5, "uint16"),
        (6, "int32"),
        (7, "uint32"),
        (10, "float32"),
        (11, "float64"),
    )
}
"""Types of pixels by their number in an IMAGE."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One point of a POINT message: its name and group, and where it is, in millimetres."""

    name: str
    group: str
    position_mm: tuple[float, float, float]
    diameter_mm: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(is_finite, (*self.position_mm, self.diameter_mm))):
            raise ConfigError(f"POINT: {self.name!r} is at {self.position_mm} mm; each number must be finite")
        for what, text, most in (("name", self.name, 64), ("group", self.group, 32)):
            _require_bytes(f"POINT: {what}", text, most)


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """POINT: a list of points."""

    kind: ClassVar[str] = "POINT"
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Position:
    """POSITION: a position in millimetres, or None, and an orientation as the quaternion (x, y, z, w)."""

    kind: ClassVar[str] = "POSITION"
    position_mm: tuple[float, float, float] | None
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not all(map(is_finite, (self.position_mm or ()) + self.quaternion)):
            raise ConfigError(f"POSITION: {self.position_mm} mm, {self.quaternion}: each number must be finite")


@dataclass(frozen=True, slots=True, kw_only=True)
class Text:
    """STRING."""

    kind: ClassVar[str] = "STRING"
    text: str

    def __post_init__(self) -> None:
        _require_bytes("STRING: its text", self.text, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """STATUS: a code of the protocol, a code of one's own, a name, and a sentence."""

    kind: ClassVar[str] = "STATUS"
    code: int
    subcode: int = 0
    name: str = ""
    message: str = ""

    def __post_init__(self) -> None:
        _require_whole("STATUS: code", self.code, 0, 0xFFFF)
        _require_whole("STATUS: subcode", self.subcode, -(1 << 63), (1 << 63) - 1)
        _require_bytes("STATUS: name", self.name, STATUS_NAME_BYTES)
        _require_bytes("STATUS: message", self.message, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """COMMAND: a request with a number, a name, and its text, usually XML."""

    kind: ClassVar[str] = "COMMAND"
    number: int
    name: str
    text: str

    def __post_init__(self) -> None:
        _require_whole("COMMAND: number", self.number, 0, 0xFFFFFFFF)
        _require_bytes("COMMAND: name", self.name, COMMAND_NAME_BYTES)
        _require_bytes("COMMAND: text", self.text, MAX_TEXT_BYTES)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply(Command):
    """RTS_COMMAND: the answer to the COMMAND of the same number."""

    kind: ClassVar[str] = "RTS_COMMAND"


@dataclass(frozen=True, slots=True, kw_only=True)
class Other:
    """A message of another type, whose content is not decoded."""

    kind: str


Content: TypeAlias = Transform | Image | Points | Position | Text | Status | Command | Reply | Other
"""Content of a message."""


def _require_matrix(what: str, matrix: Float64[np.ndarray, "4 4"]) -> None:
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or matrix[3].tolist() != [0, 0, 0, 1]:
        raise ConfigError(
            f"{what}: the matrix is {matrix.tolist()}; it must be 4 x 4, finite, and its last row 0, 0, 0, 1"
        )


def _require_bytes(what: str, text: str, most: int) -> None:
    size = len(text.encode("utf-8", errors="surrogatepass"))
    if size > most:
        raise ConfigError(f"{what} has {size} bytes, it may have {most}; shorten it")


def _require_whole(what: str, value: int, low: int, high: int) -> None:
    if not (is_whole(value) and low <= value <= high):
        raise ConfigError(f"{what} is {value!r}, it must be a whole number from {low} to {high}")


HEADER_BYTES = 58
"""Length of the header of each message."""

_STRING = struct.Struct(">HH")
_STATUS = struct.Struct(f">Hq{STATUS_NAME_BYTES}s")
_COMMAND = struct.Struct(f">I{COMMAND_NAME_BYTES}sHI")
_POSITION = struct.Struct(">7f")
_IMAGE = struct.Struct(">HBBBB3H12f3H3H")
_TRANSFORM_BYTES = 48
_POINT_BYTES = 136

_NOWHERE = (math.nan,) * 3
"""Position of a target that has none: NaN cannot be taken for a place."""

_NO_POINT = struct.pack(">64s32s4B4f20s", b"none", b"Unselected", 0, 0, 0, 0, *_NOWHERE, 0.0, b"")
"""No points in header version 1, whose libraries take an empty body for damaged; without colour Slicer hides it."""

_ASCII = 3
_UTF8 = 106
"""``_ASCII`` and ``_UTF8``: numbers of the character sets (IANA)."""


def _character_set(text: str) -> int:
    """Return the number of the character set of a text: that of ASCII if that suffices."""
    return _ASCII if text.isascii() else _UTF8


def _text_of(data: bytes, number: int) -> str:
    """Return the text in a character set; `ConfigError` or UnicodeDecodeError if the bytes are no such text."""
    # The end of a C string, which many programs send too.
    stripped = data.rstrip(b"\0")
    if number in (_ASCII, _UTF8):
        # ASCII is a part of UTF-8, and programs send UTF-8 under either number.
        return stripped.decode("utf-8")
    raise ConfigError(f"its character set has the number {number}; send ASCII (3) or UTF-8 (106)")


def _pack(content: Content, *, version: int) -> bytes:
    """Return a content as bytes, for a header of that version."""
    match content:
        case Transform():
            matrix = np.full((4, 4), np.nan) if content.matrix is None else content.matrix
            return _by_pyigtl(_pyigtl().TransformMessage(matrix, timestamp=0.0))
        case Image():
            pixels = content.pixels
            return _by_pyigtl(_pyigtl().ImageMessage(pixels, content.matrix, content.system, timestamp=0.0))
        case Points():
            return b"".join(map(_point, content.points)) or (_NO_POINT if version == 1 else b"")
        case Position():
            return _POSITION.pack(*(content.position_mm or _NOWHERE), *content.quaternion)
        case Text():
            data = content.text.encode()
            return _STRING.pack(_character_set(content.text), len(data)) + data
        case Status():
            head = _STATUS.pack(content.code, content.subcode, content.name.encode())
            return head + content.message.encode() + b"\0"
        case Command():  # and its answer
            data = content.text.encode()
            head = _COMMAND.pack(content.number, content.name.encode(), _character_set(content.text), len(data))
            return head + data
        case Other():
            return b""


def _point(point: Point) -> bytes:
    message = _pyigtl().PointMessage(
        [point.position_mm], names=[point.name], groups=[point.group], diameters=[point.diameter_mm], timestamp=0.0
    )
    return _by_pyigtl(message)


def _unpack(kind: str, content: bytes) -> Content:
    """Return the content of a message of that type; `ConfigError` or UnicodeDecodeError if its bytes are not."""
    known = _UNPACK.get(kind)
    return Other(kind=kind) if known is None else known(content)


def _transform(content: bytes) -> Transform:
    _require_size("TRANSFORM", content, _TRANSFORM_BYTES)
    message = _pyigtl().TransformMessage()
    message.unpack(_PLAIN, content)
    matrix = np.asarray(message.matrix, dtype=np.float64)
    return Transform(matrix=None if np.isnan(matrix[:3]).all() else matrix)


def _image(content: bytes) -> Image:
    _, components, scalar, order, system, *rest = _head(_IMAGE, content)
    size = rest[:3]
    first = rest[15:18]
    part = rest[18:]
    if components != 1 or scalar not in SCALARS or order not in (1, 2) or system not in (1, 2):
        raise ConfigError(
            f"an IMAGE with {components} components, scalar type {scalar}, byte order {order} and coordinate system "
            f"{system}; send one component of a known type, byte order 1 or 2, system 1 or 2"
        )
    if first != [0, 0, 0] or part != size or 0 in size:
        raise ConfigError(f"an IMAGE of the size {size} with the part {part} at {first}; send it whole")
    expected = _IMAGE.size + math.prod(size) * SCALARS[scalar].itemsize
    _require_size(f"IMAGE of the size {size}", content, expected)
    message = _pyigtl().ImageMessage()
    message.unpack(_PLAIN, content)
    pixels = message.image.astype(SCALARS[scalar], copy=False)
    return Image(pixels=pixels, matrix=message.ijk_to_world_matrix, system="ras" if system == 1 else "lps")


def _points(content: bytes) -> Points:
    if content == _NO_POINT:
        return Points(points=())
    if len(content) % _POINT_BYTES:
        raise ConfigError(f"{len(content)} bytes, each POINT has {_POINT_BYTES}")
    message = _pyigtl().PointMessage()
    message.unpack(_PLAIN, content)
    values = zip(message.names, message.groups, message.positions, message.diameters, strict=True)
    return Points(
        points=tuple(
            Point(name=name, group=group, position_mm=position, diameter_mm=diameter)
            for name, group, position, diameter in values
        )
    )


def _position(content: bytes) -> Position:
    # The standard allows a position alone, and one with three numbers of a unit quaternion.
    if len(content) not in (12, 24, _POSITION.size):
        raise ConfigError(f"{len(content)} bytes, a POSITION has 12, 24 or {_POSITION.size}")
    values = struct.unpack(f">{len(content) // 4}f", content)
    position = values[:3]
    turned = values[3:]
    if len(turned) == 3:
        turned = (*turned, math.sqrt(max(0.0, 1 - sum(value**2 for value in turned))))
    place = None if all(map(math.isnan, position)) else position
    return Position(position_mm=place, quaternion=turned or (0.0, 0.0, 0.0, 1.0))


def _string(content: bytes) -> Text:
    number, size = _head(_STRING, content)
    _require_size("STRING", content, _STRING.size + size)
    return Text(text=_text_of(content[_STRING.size :], number))


def _status(content: bytes) -> Status:
    code, subcode, name = _head(_STATUS, content)
    message = content[_STATUS.size :]
    return Status(code=code, subcode=subcode, name=_c_text(name), message=_c_text(message))


def _command(kind: type[Command], content: bytes) -> Command:
    number, name, encoding, size = _head(_COMMAND, content)
    _require_size(kind.kind, content, _COMMAND.size + size)
    return kind(number=number, name=_c_text(name), text=_text_of(content[_COMMAND.size :], encoding))


def _c_text(data: bytes) -> str:
    return data.partition(b"\0")[0].decode("utf-8")


def _head(form: struct.Struct, content: bytes) -> tuple[Any, ...]:
    """Return the fields at the beginning of a content."""
    if len(content) < form.size:
        raise ConfigError(f"{len(content)} bytes, its head alone has {form.size}")
    return form.unpack_from(content)


def _require_size(what: str, content: bytes, size: int) -> None:
    if len(content) != size:
        raise ConfigError(f"{len(content)} bytes, a {what} has {size}")


_UNPACK: dict[str, Callable[[bytes], Content]] = {
    "TRANSFORM": _transform,
    "IMAGE": _image,
    "POINT": _points,
    "POSITION": _position,
    "STRING": _string,
    "STATUS": _status,
    "COMMAND": partial(_command, Command),
    "RTS_COMMAND": partial(_command, Reply),
}

KINDS = tuple(_UNPACK)
"""Types of messages whose contents are decoded."""

_PLAIN = {"header_version": 1, "message_type": "", "device_name": "", "timestamp": 0.0}
"""Header as pyigtl wants it, for a content alone."""


def _by_pyigtl(message: Any) -> bytes:
    """Return the content of a message, without the header that pyigtl makes."""
    return bytes(message.pack()[HEADER_BYTES:])


def _crc(body: bytes) -> int:
    """Return the checksum of a body (CRC-64 of ECMA-182, as in the standard)."""
    return int(_pyigtl().messages.CRC64(body))


@cache
def _pyigtl() -> Any:
    with needs_package("pyigtl", extra="igtl", purpose="OpenIGTLink"):
        import pyigtl
    return pyigtl


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
    """Return a message as bytes, with its checksum."""
    body = _pack(message.content, version=message.version)
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
        _crc(body),
    )
    return head + body


def asks_for_metadata() -> bytes:
    """Return a message after which a PLUS server sends header version 2, with metadata; it sends version 1 before.

    PlusServer answers each client in the highest version that came from it, and takes a STATUS for a sign of life.
    """
    return encode(Message(device="markerseek", content=Status(code=OK)))


def decode_header(data: bytes, *, most_bytes: int) -> Header:
    """Return the header of a message, checked before its body is awaited.

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
    """Return the message with that header and body.

    Raises `DeviceError` if the checksum does not fit, a length is wrong, or a number is not finite; the message says
    which.
    """
    what = f"OpenIGTLink: {header.kind} {header.device!r}"
    if len(body) != header.body_bytes:
        raise DeviceError(f"{what}: {len(body)} bytes came, the header says {header.body_bytes}")
    found = _crc(body)
    if found != header.crc:
        raise DeviceError(f"{what}: its CRC is {header.crc:016X}, that of what came is {found:016X}; send it again")
    content, metadata = (body, {}) if header.version == 1 else _without_metadata(body, what)
    try:
        return Message(
            device=header.device,
            content=_unpack(header.kind, content),
            time_s=header.time_s,
            metadata=metadata,
            version=1 if header.version == 1 else 2,
        )
    except (ConfigError, UnicodeDecodeError) as problem:
        raise DeviceError(f"{what}: {problem}") from problem


def is_emulated_server(header: Header, body: bytes) -> bool:
    """Return whether a STATUS says that its server is an emulator; errors as of `decode`."""
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

    def feed(self, data: bytes) -> Iterator[tuple[Header, bytes]]:
        """Yield the header and body of each message that is complete with these bytes; errors as of `decode_header`."""
        self._received += data
        while True:
            if self._header is None:
                if len(self._received) < HEADER_BYTES:
                    return
                # Its length is limited here, before the body is awaited.
                self._header = decode_header(self._take(HEADER_BYTES), most_bytes=self._most_bytes)
            if len(self._received) < self._header.body_bytes:
                return
            header = self._header
            self._header = None
            yield header, self._take(header.body_bytes)

    def _take(self, size: int) -> bytes:
        data = bytes(self._received[:size])
        del self._received[:size]
        return data


def _name(field_: bytes, what: str) -> str:
    name = field_.rstrip(b"\0 ")
    if not (name.isascii() and all(32 <= byte < 127 for byte in name)):
        raise DeviceError(f"OpenIGTLink: its {what} {name!r} is no text; this is another protocol")
    return name.decode("ascii")


def _metadata(values: Mapping[str, str]) -> tuple[bytes, bytes]:
    """Return the table of contents of the metadata, and the metadata."""
    index = struct.pack(">H", len(values))
    data = b""
    for key, value in values.items():
        name = key.encode()
        text = value.encode()
        index += _ENTRY.pack(len(name), _character_set(value), len(text))
        data += name + text
    return index, data


def _without_metadata(body: bytes, what: str) -> tuple[bytes, dict[str, str]]:
    """Return the content and metadata of a body with an extended header."""
    if len(body) < _EXTENDED.size:
        raise DeviceError(f"{what}: {len(body)} bytes are too few for an extended header")
    start, index_bytes, data_bytes, _ = _EXTENDED.unpack_from(body)
    end = len(body) - index_bytes - data_bytes
    if not _EXTENDED.size <= start <= end:
        raise DeviceError(f"{what}: extended header and metadata are longer than its body")
    if index_bytes == 0:
        return body[start:end], {}
    index = body[end : end + index_bytes]
    data = body[end + index_bytes :]
    count = int.from_bytes(index[:2], "big")
    if count > _MAX_ENTRIES or len(index) != 2 + _ENTRY.size * count:
        raise DeviceError(f"{what}: {count} entries of metadata in {len(index)} bytes; at most {_MAX_ENTRIES} are read")
    metadata = {}
    at = 0
    for key_bytes, number, value_bytes in _ENTRY.iter_unpack(index[2:]):
        after = at + key_bytes + value_bytes
        if after > len(data):
            raise DeviceError(f"{what}: its metadata are longer than their space")
        try:
            key = data[at : at + key_bytes].decode()
            metadata[key] = _text_of(data[at + key_bytes : after], number)
        except (UnicodeDecodeError, ConfigError) as problem:
            raise DeviceError(f"{what}: its metadata are no text: {problem}") from problem
        at = after
    return body[start:end], metadata
