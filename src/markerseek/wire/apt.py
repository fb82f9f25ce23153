"""Thorlabs' APT protocol for a controller of one channel: messages in a stream of bytes, their contents, and units.

Thorlabs, "APT Communications Protocol", issue 39. A message has six bytes: identity, two parameters, destination,
source; or, if the destination's highest bit is set, identity, length of the data, destination, source, and then the
data. There is no checksum, only the form is checked: what does not look like a message is discarded a byte at a time
until something does. A message to a device has an identity ``SET`` or ``REQ``, and its answer ``GET``. Numbers are
little-endian. Words for angle, speed and acceleration are rounded, never truncated.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from markerseek.core import ConfigError, DeviceError

HEADER_BYTES = 6

HOST = 0x01
CONTROLLER = 0x50

_HEADER = struct.Struct("<HHBB")
_WITH_DATA = 0x80

Forms = Mapping[int, frozenset[int]]
"""Identity of a message to the lengths that its data can have; 0 is the form of six bytes."""

_STATUS_LENGTHS = frozenset(range(14, 30, 2))
"""Lengths of a status: 14 bytes, and what later firmware appends."""

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
    0x0464: _STATUS_LENGTHS | {0},  # move completed
    0x0466: _STATUS_LENGTHS | {0},  # stopped
    0x0481: _STATUS_LENGTHS,  # status
    0x0491: _STATUS_LENGTHS,  # status
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
    are discarded, but for those with data to address 0, which some controllers send.
    """

    def __init__(self, forms: Forms = TO_HOST, *, to: int = HOST) -> None:
        self._forms = forms
        self._to = to
        self._held = bytearray()

    def feed(self, data: bytes) -> list[AptMessage]:
        """Return the messages that are complete with these bytes; what cannot be one is discarded."""
        held = self._held
        held += data
        messages = []
        at = 0
        while len(held) - at >= HEADER_BYTES:
            size = self._size(at)
            # Resynchronise byte by byte: after a lost byte the next header can begin anywhere.
            if size is None:
                at += 1
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
        self._held.clear()

    def _size(self, at: int) -> int | None:
        """Return the length of the message that begins here; None if none does."""
        ident, length, to, _source = _HEADER.unpack_from(self._held, at)
        # Known identity, own address and a length that belongs to it: together they stand in for the checksum.
        lengths = self._forms.get(ident)
        if lengths is None or (to & ~_WITH_DATA != self._to and to != _WITH_DATA):
            return None
        wanted = length if to & _WITH_DATA else 0
        if wanted not in lengths or (to & _WITH_DATA and wanted == 0):
            return None
        return HEADER_BYTES + wanted


CONTROLLERS = ("KDC101", "TDC001")
"""Models of controllers that turn a PRM1-Z8."""

COUNTS_PER_DEG = 1919.6418578623391
SPEED_WORD = 42941.66
ACCELERATION_WORD = 14.6574
"""Counts for a degree of a PRM1-Z8, and words for 1 deg/s and 1 deg/s², from the protocol's table of scaling factors.

The controller's clock ticks every 2048/6e6 s = T: speed = counts x T x 65536, acceleration = counts x T² x 65536.
"""

CHANNEL = 1

EMULATOR = "simulated by markerseek"
"""Notes in the identity of an emulated controller."""

INFO = 0x0006
VELOCITY = 0x0415
BACKLASH = 0x043C
LIMITS = 0x0425
TARGET = 0x0452
STATUS = 0x0491
TRIGGER_PORTS = 0x0525
"""Identities of the answers that `decode` knows."""

_DATA = {
    INFO: struct.Struct("<i8sH4B60s3H"),
    VELOCITY: struct.Struct("<H3i"),
    BACKLASH: struct.Struct("<Hi"),
    LIMITS: struct.Struct("<3H2iH"),
    TARGET: struct.Struct("<Hi"),
    STATUS: struct.Struct("<HihHI"),
    TRIGGER_PORTS: struct.Struct("<5H2x"),
}
"""Data of those answers, and of the messages that set the same: channel first, but of the identity."""

TRIGGER_OFF = 0x00
"""Mode of a trigger port that does nothing."""

_ACTIVE_HIGH = 1

_MOVING = 0xF0
_HOMING = 0x200
_HOMED = 0x400
_ENABLED = 0x80000000
_FAULTS = {
    0x4000: "motion error",
    0x8000: "instrument error",
    0x20000: "too hot",
    0x40000: "supply voltage",
    0x80000: "commutation error",
    0x1000000: "motor current at its limit",
    0x2000000: "encoder fault",
    0x4000000: "too much current",
    0x8000000: "current fault",
    0x40000000: "error",
}
"""Status bits that end a move, and their names. The limit switches are missing: a PRM1Z8 touches one at home."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """Identity of a controller: model, serial number, firmware, and the maker's notes."""

    model: str
    serial_number: int
    firmware: str
    notes: str = ""

    @property
    def emulated(self) -> bool:
        """Whether it says of itself that it is the emulator, and no hardware."""
        return self.notes == EMULATOR


@dataclass(frozen=True, slots=True, kw_only=True)
class Velocity:
    """Speed and acceleration, in the controller's words."""

    acceleration: int
    speed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftLimits:
    """Soft limits in counts, and the behaviour there and at the limit switches."""

    low: int
    high: int
    """``low`` and ``high``: ends of the range, in counts."""
    mode: int = 2
    """At a soft limit: 1 ignores it, 2 stops at once, 3 decelerates."""
    switches: int = 4
    """Behaviour of both limit switches: 4 makes on contact, and serves for homing only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Status of the stage."""

    position: int
    """Position counter, signed."""
    moving: bool
    homing: bool
    homed: bool
    """``moving``, ``homing`` and ``homed``: ``moving`` is false for a moment after a move was commanded."""
    faults: tuple[str, ...]
    """Names of the errors that it reports."""
    enabled: bool = True
    """Whether the motor of its channel gets current."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """A stored number of counts: a target, or a backlash."""

    counts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TriggerPorts:
    """Modes of the two trigger ports; an active output is high."""

    first: int = TRIGGER_OFF
    second: int = TRIGGER_OFF
    polarities: tuple[int, int] = (_ACTIVE_HIGH, _ACTIVE_HIGH)


ControllerAnswer = Info | Velocity | SoftLimits | Status | Counts | TriggerPorts


def counts_of(angle_deg: float) -> int:
    """Return the encoder counts of an angle in degrees, rounded."""
    return _word(angle_deg * COUNTS_PER_DEG, f"{angle_deg} deg")


def degrees_of(counts: int) -> float:
    """Return the angle in degrees of a number of encoder counts."""
    return counts / COUNTS_PER_DEG


def speed_word(speed_deg_s: float) -> int:
    """Return the word for a speed in degrees per second, rounded."""
    return _word(speed_deg_s * SPEED_WORD, f"{speed_deg_s} deg/s")


def acceleration_word(acceleration_deg_s2: float) -> int:
    """Return the word for an acceleration in degrees per second squared, rounded."""
    return _word(acceleration_deg_s2 * ACCELERATION_WORD, f"{acceleration_deg_s2} deg/s^2")


def _word(value: float, meaning: str) -> int:
    if not (math.isfinite(value) and -(2**31) <= round(value) < 2**31):
        raise ConfigError(f"{meaning} cannot be sent to the stage's controller, whose words have 32 bits")
    return round(value)


def _short(ident: int, first: int = 0, second: int = 0) -> bytes:
    return struct.pack("<H4B", ident, first, second, CONTROLLER, HOST)


def _set(answer: int, *values: int) -> bytes:
    """Return the message that sets what an answer says: its identity is lower by two."""
    data = _DATA[answer].pack(CHANNEL, *values)
    return struct.pack("<HHBB", answer - 2, len(data), CONTROLLER | 0x80, HOST) + data


def ask(answer: int) -> bytes:
    """Return the request of an answer, whose identity is lower by one."""
    return _short(answer - 1, 0 if answer == INFO else CHANNEL)


def stop_updates() -> bytes:
    """Send nothing unasked."""
    return _short(0x0012)


def enable_channel() -> bytes:
    """Give the motor current; nothing moves."""
    return _short(0x0210, CHANNEL, 1)


def set_velocity(velocity: Velocity) -> bytes:
    """Set speed and acceleration of later moves."""
    return _set(VELOCITY, 0, velocity.acceleration, velocity.speed)


def set_backlash(counts: int) -> bytes:
    """Set by how many counts downward moves overshoot and come back."""
    return _set(BACKLASH, counts)


def set_limits(limits: SoftLimits) -> bytes:
    """Set the soft limits."""
    return _set(LIMITS, limits.switches, limits.switches, limits.high, limits.low, limits.mode)


def set_target(counts: int) -> bytes:
    """Store a target; nothing moves yet."""
    return _set(TARGET, counts)


def set_trigger_ports(ports: TriggerPorts) -> bytes:
    """Set what the trigger ports do."""
    return _set(TRIGGER_PORTS, ports.first, ports.polarities[0], ports.second, ports.polarities[1])


def move() -> bytes:
    """Move to the stored target, also during another move."""
    return _short(0x0453, CHANNEL)


def stop(*, profiled: bool = False) -> bytes:
    """Stop at once, without deceleration, or with the deceleration that was set."""
    return _short(0x0465, CHANNEL, 2 if profiled else 1)


def decode(message: AptMessage) -> ControllerAnswer | None:
    """Return the content of an answer; None if no request of this module asks for it.

    Raises `DeviceError` if it is of another channel, or no controller can have sent it.
    """
    layout = _DATA.get(message.ident)
    if layout is None:
        return None
    channel, *words = layout.unpack_from(message.data)
    if message.ident == INFO:
        return _info(channel, *words)
    _require_channel(channel)
    return _CONTENTS[message.ident](words)


def _require_channel(channel: int) -> None:
    if channel != CHANNEL:
        raise DeviceError(f"a stage's answer is of channel {channel}, there is only channel {CHANNEL}")


def _info(serial_number: int, name: bytes, _kind: int, *rest: Any) -> Info:
    minor, interim, major, _unused, notes, *_hardware = rest
    # The field is padded by zeros or blanks. Anything but letters and digits shows that the message is damaged.
    model = name.rstrip(b"\x00 ")
    if not model.isalnum():
        raise DeviceError(f"the stage's controller reports the model {model!r}, which is no model name")
    return Info(
        model=model.decode("ascii"),
        serial_number=serial_number,
        firmware=f"{major}.{interim}.{minor}",
        notes=notes.rstrip(b"\x00 ").decode("ascii", "replace"),
    )


def _limits(upper_switch: int, lower_switch: int, high: int, low: int, mode: int) -> SoftLimits:
    if upper_switch != lower_switch:
        raise DeviceError("the stage's two limit switches are set differently")
    return SoftLimits(low=low, high=high, mode=mode, switches=upper_switch)


def _status(position: int, bits: int) -> Status:
    return Status(
        position=position,
        moving=bool(bits & _MOVING),
        homing=bool(bits & _HOMING),
        homed=bool(bits & _HOMED),
        faults=tuple(words for bit, words in _FAULTS.items() if bits & bit),
        enabled=bool(bits & _ENABLED),
    )


_CONTENTS: dict[int, Callable[[list[int]], ControllerAnswer]] = {
    VELOCITY: lambda words: Velocity(acceleration=words[1], speed=words[2]),
    BACKLASH: lambda words: Counts(counts=words[0]),
    LIMITS: lambda words: _limits(*words),
    TARGET: lambda words: Counts(counts=words[0]),
    STATUS: lambda words: _status(words[0], words[3]),
    TRIGGER_PORTS: lambda words: TriggerPorts(first=words[0], second=words[2], polarities=(words[1], words[3])),
}
