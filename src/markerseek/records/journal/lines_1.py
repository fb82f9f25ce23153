"""The prefix of a line in files of version 1, which are read and not written any more.

Each line began with five numbers of fixed width: its number, the bytes of the rest of the line, those of the frame
behind it, the CRC-32 of these three, and that of the rest and the frame. Each sum went on from the one before it.
"""

from __future__ import annotations

import zlib
from typing import TypeAlias

Numbers: TypeAlias = tuple[int, int, int, int, int]

_LENGTHS = b'{"number":%8d,"bytes":%9d,"frame_bytes":%9d,'
_SUMS = b'"check":%10d,"crc":%10d,'
_LENGTHS_BYTES = len(_LENGTHS % (0, 0, 0))
PREFIX_1_BYTES = _LENGTHS_BYTES + len(_SUMS % (0, 0))


def numbers_1(prefix: bytes) -> Numbers | None:
    """The five numbers of a prefix; None where it is none."""
    try:
        fields = [int(each.rpartition(b":")[2]) for each in prefix.rstrip(b",").split(b",")]
        number, rest_bytes, frame_bytes, check, own = fields
    except ValueError:
        return None
    if min(fields) < 0 or prefix != _LENGTHS % (number, rest_bytes, frame_bytes) + _SUMS % (check, own):
        return None
    return number, rest_bytes, frame_bytes, check, own


def prefix_agrees(prefix: bytes, numbers: Numbers, *, previous: int) -> bool:
    """Whether the lengths agree with their sum, which goes on from that of the line before."""
    return zlib.crc32(prefix[:_LENGTHS_BYTES], previous) == numbers[3]
