"""Contents of OpenIGTLink messages as bytes: packed, and unpacked with each length checked.

TRANSFORM, IMAGE and POINT by pyigtl, and the CRC by the package that it brings.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from markerseek.core import ConfigError, needs_package
from markerseek.wire.igtl import contents

HEADER_BYTES = 58
"""Length of the header of each message."""

_STRING = struct.Struct(">HH")
_STATUS = struct.Struct(f">Hq{contents.STATUS_NAME_BYTES}s")
_COMMAND = struct.Struct(f">I{contents.COMMAND_NAME_BYTES}sHI")
_POSITION = struct.Struct(">7f")
_IMAGE = struct.Struct(">HBBBB3H12f3H3H")
_TRANSFORM_BYTES, _POINT_BYTES = 48, 136

_NOWHERE = (math.nan,) * 3
"""Position that is none: the only numbers that nobody can take for a place."""

_NO_POINT = struct.pack(">64s32s4B4f20s", b"none", b"Unselected", 0, 0, 0, 0, *_NOWHERE, 0.0, b"")
"""No points in header version 1, whose libraries take an empty body for damaged; without colour Slicer hides it."""

_ASCII, _UTF8 = 3, 106
"""Numbers of the character sets (IANA)."""


def character_set(text: str) -> int:
    """Number of the character set of a text: that of ASCII if that suffices."""
    return _ASCII if text.isascii() else _UTF8


def text_of(data: bytes, number: int) -> str:
    """Text in a character set; `ConfigError` or UnicodeDecodeError if the bytes are no such text."""
    # The end of a C string, which many programs send too.
    stripped = data.rstrip(b"\0")
    if number in (_ASCII, _UTF8):
        # ASCII is a part of UTF-8, and programs send UTF-8 under either number.
        return stripped.decode("utf-8")
    raise ConfigError(f"its character set has the number {number}; send ASCII (3) or UTF-8 (106)")


def pack(content: contents.Content, *, version: int) -> bytes:
    """A content as bytes, for a header of that version."""
    match content:
        case contents.Transform():
            matrix = np.full((4, 4), np.nan) if content.matrix is None else content.matrix
            return _by_pyigtl(_pyigtl().TransformMessage(matrix, timestamp=0.0))
        case contents.Image():
            pixels = content.pixels
            return _by_pyigtl(_pyigtl().ImageMessage(pixels, content.matrix, content.system, timestamp=0.0))
        case contents.Points():
            return b"".join(map(_point, content.points)) or (_NO_POINT if version == 1 else b"")
        case contents.Position():
            return _POSITION.pack(*(content.position_mm or _NOWHERE), *content.quaternion)
        case contents.Text():
            data = content.text.encode()
            return _STRING.pack(character_set(content.text), len(data)) + data
        case contents.Status():
            head = _STATUS.pack(content.code, content.subcode, content.name.encode())
            return head + content.message.encode() + b"\0"
        case contents.Command():  # and its answer
            data = content.text.encode()
            head = _COMMAND.pack(content.number, content.name.encode(), character_set(content.text), len(data))
            return head + data
        case contents.Other():
            return b""


def _point(point: contents.Point) -> bytes:
    message = _pyigtl().PointMessage(
        [point.position_mm], names=[point.name], groups=[point.group], diameters=[point.diameter_mm], timestamp=0.0
    )
    return _by_pyigtl(message)


def unpack(kind: str, content: bytes) -> contents.Content:
    """Content of a message of that type; `ConfigError` or UnicodeDecodeError if its bytes are not."""
    known = _UNPACK.get(kind)
    return contents.Other(kind=kind) if known is None else known(content)


def _transform(content: bytes) -> contents.Transform:
    _require_size("TRANSFORM", content, _TRANSFORM_BYTES)
    message = _pyigtl().TransformMessage()
    message.unpack(_PLAIN, content)
    matrix = np.asarray(message.matrix, dtype=np.float64)
    return contents.Transform(matrix=None if np.isnan(matrix[:3]).all() else matrix)


def _image(content: bytes) -> contents.Image:
    _, components, scalar, order, system, *rest = _head(_IMAGE, content)
    size, first, part = rest[:3], rest[15:18], rest[18:]
    if components != 1 or scalar not in contents.SCALARS or order not in (1, 2) or system not in (1, 2):
        raise ConfigError(
            f"an IMAGE with {components} components, scalar type {scalar}, byte order {order} and coordinate system "
            f"{system}; send one component of a known type, byte order 1 or 2, system 1 or 2"
        )
    if first != [0, 0, 0] or part != size or 0 in size:
        raise ConfigError(f"an IMAGE of the size {size} with the part {part} at {first}; send it whole")
    expected = _IMAGE.size + math.prod(size) * contents.SCALARS[scalar].itemsize
    _require_size(f"IMAGE of the size {size}", content, expected)
    message = _pyigtl().ImageMessage()
    message.unpack(_PLAIN, content)
    pixels = message.image.astype(contents.SCALARS[scalar], copy=False)
    return contents.Image(pixels=pixels, matrix=message.ijk_to_world_matrix, system="ras" if system == 1 else "lps")


def _points(content: bytes) -> contents.Points:
    if content == _NO_POINT:
        return contents.Points(points=())
    if len(content) % _POINT_BYTES:
        raise ConfigError(f"{len(content)} bytes, each POINT has {_POINT_BYTES}")
    message = _pyigtl().PointMessage()
    message.unpack(_PLAIN, content)
    values = zip(message.names, message.groups, message.positions, message.diameters, strict=True)
    return contents.Points(
        points=tuple(
            contents.Point(name=name, group=group, position_mm=position, diameter_mm=diameter)
            for name, group, position, diameter in values
        )
    )


def _position(content: bytes) -> contents.Position:
    # The standard allows a position alone, and one with three numbers of a unit quaternion.
    if len(content) not in (12, 24, _POSITION.size):
        raise ConfigError(f"{len(content)} bytes, a POSITION has 12, 24 or {_POSITION.size}")
    values = struct.unpack(f">{len(content) // 4}f", content)
    position, turned = values[:3], values[3:]
    if len(turned) == 3:
        turned = (*turned, math.sqrt(max(0.0, 1 - sum(value**2 for value in turned))))
    place = None if all(map(math.isnan, position)) else position
    return contents.Position(position_mm=place, quaternion=turned or (0.0, 0.0, 0.0, 1.0))


def _string(content: bytes) -> contents.Text:
    number, size = _head(_STRING, content)
    _require_size("STRING", content, _STRING.size + size)
    return contents.Text(text=text_of(content[_STRING.size :], number))


def _status(content: bytes) -> contents.Status:
    code, subcode, name = _head(_STATUS, content)
    message = content[_STATUS.size :]
    return contents.Status(code=code, subcode=subcode, name=_c_text(name), message=_c_text(message))


def _command(kind: type[contents.Command], content: bytes) -> contents.Command:
    number, name, encoding, size = _head(_COMMAND, content)
    _require_size(kind.kind, content, _COMMAND.size + size)
    return kind(number=number, name=_c_text(name), text=text_of(content[_COMMAND.size :], encoding))


def _c_text(data: bytes) -> str:
    return data.partition(b"\0")[0].decode("utf-8")


def _head(form: struct.Struct, content: bytes) -> tuple[Any, ...]:
    """Fields at the beginning of a content."""
    if len(content) < form.size:
        raise ConfigError(f"{len(content)} bytes, its head alone has {form.size}")
    return form.unpack_from(content)


def _require_size(what: str, content: bytes, size: int) -> None:
    if len(content) != size:
        raise ConfigError(f"{len(content)} bytes, a {what} has {size}")


_UNPACK: dict[str, Callable[[bytes], contents.Content]] = {
    "TRANSFORM": _transform,
    "IMAGE": _image,
    "POINT": _points,
    "POSITION": _position,
    "STRING": _string,
    "STATUS": _status,
    "COMMAND": partial(_command, contents.Command),
    "RTS_COMMAND": partial(_command, contents.Reply),
}

KINDS = tuple(_UNPACK)
"""Types of messages whose contents are decoded."""

_PLAIN = {"header_version": 1, "message_type": "", "device_name": "", "timestamp": 0.0}
"""Header as pyigtl wants it, for a content alone."""


def _by_pyigtl(message: Any) -> bytes:
    """Content of a message, without the header that pyigtl makes."""
    return bytes(message.pack()[HEADER_BYTES:])


def crc(body: bytes) -> int:
    """Checksum of a body (CRC-64 of ECMA-182, as in the standard)."""
    return int(_pyigtl().messages.CRC64(body))


@cache
def _pyigtl() -> Any:
    with needs_package("pyigtl", extra="igtl", purpose="OpenIGTLink"):
        import pyigtl
    return pyigtl
