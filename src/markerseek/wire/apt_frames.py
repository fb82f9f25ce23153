"""Framing of Thorlabs' APT protocol: messages from a stream of bytes. Without a checksum, only the form is checked.

A message has six bytes: identity, two parameters, destination, source; or, if the destination's highest bit is set,
identity, length of the data, destination, source, and then the data. What does not look like a message of the right
form is discarded a byte at a time until something does.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass

HEADER_BYTES = 6

HOST = 0x01
CONTROLLER = 0x50

_HEADER = struct.Struct("<HHBB")
_WITH_DATA = 0x80

Forms = Mapping[int, frozenset[int]]
"""Identity of a message to the lengths that its data can have; 0 is the form of six bytes."""

TO_HOST: Forms = {
    0x0002: frozenset({0}),  # disconnecting
    0x0006: frozenset({84}),  # identity
    0x0080: frozenset({0}),  # an error
    0x0081: frozenset({68}),  # an error in words
    0x0212: frozenset({0}),  # channel enabled or not
    0x040B: frozenset({6}),  # encoder counter
    0x0412: frozenset({6}),  # position counter
    0x0415: frozenset({14}),  # velocity and acceleration
    0x0418: frozenset({22}),  # jogging
    0x0425: frozenset({16}),  # limits
    0x042A: frozenset({6}),  # status bits
    0x043C: frozenset({6}),  # backlash
    0x0442: frozenset({14}),  # homing
    0x0444: frozenset({0}),  # homed
    0x0447: frozenset({6}),  # stored relative move
    0x0452: frozenset({6}),  # stored target
    0x0464: frozenset({0, 14}),  # move completed
    0x0466: frozenset({0, 14}),  # stopped
    0x0481: frozenset({14}),  # status
    0x0491: frozenset({14}),  # status
    0x0525: frozenset({12}),  # trigger ports
    0x0528: frozenset({34}),  # trigger positions
}
"""Messages from a motor controller of one channel."""

TO_CONTROLLER: Forms = {
    **{
        ident: frozenset({0})
        for ident in (
            *(0x0002, 0x0005, 0x0011, 0x0012, 0x0018, 0x0060, 0x0065, 0x0210, 0x0211, 0x0223),
            *(0x040A, 0x0411, 0x0414, 0x0417, 0x0424, 0x0429, 0x043B, 0x0441, 0x0443, 0x0446, 0x0451),
            *(0x0457, 0x0465, 0x046A, 0x046B, 0x046C, 0x0480, 0x0490, 0x0492, 0x0524, 0x0527),
        )
    },
    **{ident: frozenset({6}) for ident in (0x0409, 0x0410, 0x043A, 0x0445, 0x0450)},
    **{ident: frozenset({14}) for ident in (0x0413, 0x0440)},
    **{ident: frozenset({0, 6}) for ident in (0x0448, 0x0453)},
    0x0416: frozenset({22}),
    0x0423: frozenset({16}),
    0x0523: frozenset({12}),
    0x0526: frozenset({34}),
}
"""Messages to such a controller."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AptMessage:
    """One message."""

    ident: int
    data: bytes
    """Its data; empty in the form of six bytes."""
    raw: bytes


class AptFramer:
    """Splits a stream into messages, for one of the two ends.

    ``forms``: which messages are known, and how long their data may be. ``to``: address of this end; messages to others
    are discarded.
    """

    def __init__(self, forms: Forms = TO_HOST, *, to: int = HOST) -> None:
        self._forms = forms
        self._to = to
        self._held = bytearray()
        self.discarded = 0

    def feed(self, data: bytes) -> list[AptMessage]:
        """Messages that are complete with these bytes; what cannot be one is counted in ``discarded``."""
        held = self._held
        held += data
        messages = []
        at = 0
        while len(held) - at >= HEADER_BYTES:
            size = self._size(at)
            # Resynchronise byte by byte: after a lost byte the next header can begin anywhere.
            if size is None:
                at += 1
                self.discarded += 1
                continue
            if len(held) - at < size:
                break
            raw = bytes(held[at : at + size])
            messages.append(AptMessage(ident=int.from_bytes(raw[:2], "little"), data=raw[HEADER_BYTES:], raw=raw))
            at += size
        del held[:at]
        return messages

    def forget(self) -> None:
        """Drop the beginning of a message whose rest did not come."""
        # Counted, since bytes that fit no message show a bad cable or another program.
        self.discarded += len(self._held)
        self._held.clear()

    def _size(self, at: int) -> int | None:
        """Length of the message that begins here; None if none does."""
        ident, length, to, _source = _HEADER.unpack_from(self._held, at)
        # Known identity, own address and a length that belongs to it: together they stand in for the checksum.
        lengths = self._forms.get(ident)
        if lengths is None or to & ~_WITH_DATA != self._to:
            return None
        wanted = length if to & _WITH_DATA else 0
        if wanted not in lengths or (to & _WITH_DATA and wanted == 0):
            return None
        return HEADER_BYTES + wanted
