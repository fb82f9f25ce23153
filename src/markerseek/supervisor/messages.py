"""Messages between the control process and its supervisor: kind, line, length, then the bytes.

=======  ==========================  =======  ===================================================
to it    from the control process    from it  to the control process
=======  ==========================  =======  ===================================================
WRITE    bytes for a line            DATA     bytes from a line
ARM      accept writes again         READY    lines are open, or it is armed again
HOLD     the lease begins            LAPSED   why the lines were released; writes are refused
BEAT     a step of the control loop  FAILED   why it did not start, or cannot be armed
RELEASE  the lease ends
=======  ==========================  =======  ===================================================
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from enum import IntEnum

from markerseek.core import DeviceError

# Kind, line and length, big-endian. The two ends are the same program, so that no version is sent.
_HEAD = struct.Struct(">BBH")
_STEP = struct.Struct(">Q")

MAX_BYTES = 4096
"""Longest message, without its header."""


class Kind(IntEnum):
    """Kind of a message."""

    # ASCII initials, for reading a trace: W, A, H, B, R; D, O(pen), L, F.
    WRITE = 0x57
    ARM = 0x41
    HOLD = 0x48
    BEAT = 0x42
    RELEASE = 0x52
    DATA = 0x44
    READY = 0x4F
    LAPSED = 0x4C
    FAILED = 0x46


_KINDS = {int(kind): kind for kind in Kind}


def packed(kind: Kind, data: bytes = b"", *, line: int = 0) -> bytes:
    """Return one message as bytes, with the number of the line where it belongs to one.

    Raises `DeviceError` if there are more than `MAX_BYTES`.
    """
    if len(data) > MAX_BYTES:
        raise DeviceError(f"supervisor: a message of {len(data)} bytes; the limit is {MAX_BYTES}")
    return _HEAD.pack(kind, line, len(data)) + data


def packed_beat(step: int) -> bytes:
    """Return a beat, which carries the control loop's step."""
    return packed(Kind.BEAT, _STEP.pack(step))


def step_of(data: bytes) -> int:
    """Return the step that a message carries.

    Raises `DeviceError` if it carries none.
    """
    if len(data) != _STEP.size:
        raise DeviceError(f"supervisor: a step of {len(data)} bytes; it has {_STEP.size}")
    return int(_STEP.unpack(data)[0])


def unpacked(buffer: bytearray) -> Iterator[tuple[Kind, int, bytes]]:
    """Yield the kind, line and bytes of each whole message, which is taken out of the buffer.

    Raises `DeviceError` if what comes next is no message.
    """
    while len(buffer) >= _HEAD.size:
        number, line, size = _HEAD.unpack_from(buffer)
        kind = _KINDS.get(number)
        # A stream that is out of step cannot be trusted again: either end gives up.
        if kind is None or size > MAX_BYTES:
            raise DeviceError(f"supervisor: {bytes(buffer[: _HEAD.size]).hex(' ')} is no message")
        if len(buffer) < _HEAD.size + size:
            return
        data = bytes(buffer[_HEAD.size : _HEAD.size + size])
        del buffer[: _HEAD.size + size]
        yield kind, line, data
