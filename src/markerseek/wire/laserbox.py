"""Protocol of the laser box, which triggers laser and acquisition and counts the pulses: lines as bytes.

A line is words separated by one space, a star, and the CRC-16/CCITT-FALSE of all before the star (polynomial
0x1021, start 0xFFFF, not reflected; 0x29B1 for ``123456789``) in four upper-case digits: ``BEAT 17*97F5``, then LF. A
CR before it is dropped.

======================================================  ==========================================================
host to box                                             box to host
======================================================  ==========================================================
``HELLO``                                               ``OK HELLO id version lease_ms last_token seen meter``
``PERMIT token pulses rate_hz expiry_ms triggers``      ``OK PERMIT token seen``
``BEAT step``                                           nothing
``FIRE token``                                          ``DONE token sent photodiode light`` when the train has
                                                        ended
``DISARM``                                              ``OK DISARM``
``SWEEP token pulses period_us expiry_ms``              ``OK SWEEP token seen``
after its ``FIRE``                                      ``PULSE token number stamp_us photodiode light`` for
                                                        each pulse,
                                                        ``DARK token sent photodiode`` when its light has ended, and
                                                        ``DONE`` as above when the train has
``TIME number``                                         ``OK TIME number clock_us``
anything that is refused                                ``ERR reason``
======================================================  ==========================================================

There is no "on". A permit is void after its expiry, after one firing, at the lease's end, at any refusal, at DISARM and
HELLO, and when the interlock opens, however briefly; without one there is no light. The lease begins with PERMIT and is
renewed by BEAT with a step above the last one. Tokens are numbers, and each permit's must be above all earlier ones, so
that nothing is fired twice.

``triggers`` is how often the acquisition is triggered; the first ``pulses`` of them trigger the laser too, so that a
permit of 0 pulses takes a dark frame, averaged like a lit one. They take 60 s at most. A train whose permit is
taken away is completed at the same rate without light, for an acquisition that counts triggers would wait for the rest;
until DONE is sent, HELLO and PERMIT are refused as ``BUSY``. DONE is sent `LIGHT_LATE_US` after the last trigger.

``seen`` is the photodiode's count since power-up: if it rises outside of firings, there was light without a permit.
Within any minute a box sends `MAX_PULSES_PER_MINUTE` pulses at most (refusal ``BUDGET``).

``meter`` is 1 of a box whose photodiode also measures: ``light`` of DONE is the sum over the lit pulses of what it read
of each, in counts of its own, and ``light`` of PULSE what it read of that one. Of any other box they are 0.

**Sweeps** (fly-scan). SWEEP is a permit for single pulses, void by all that voids the other, whose train runs free with
``period_us`` between two pulses at least: one that comes late puts off all others. Each pulse is stamped by the box's
own clock, in microseconds since power-up modulo 2³¹, when its trigger begins; its line follows `LIGHT_LATE_US` later
with what the photodiode saw since, and ``DARK`` follows the last of them at once. After that the train is completed
without light, up to as many triggers as pulses were permitted: an acquisition that counts them ends, and its last
frames are dark. TIME is answered at any time: the host knows by the time of question and answer what its own clock
showed, and so does with each stamp.
"""

from __future__ import annotations

import binascii
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, get_args

import msgspec

from markerseek.core import ConfigError, LaserError

VERSION = 7
"""Version of the protocol; lower numbers are those of boxes that were never released."""

EMULATOR = "emulator"
"""Identity of an emulated box."""

LEASE_MS = 100
"""Longest lease of a box, in milliseconds."""

LINE_BYTES = 80
"""Longest line, its end included."""

MAX_PULSES = 1024
MAX_RATE_HZ = 1000
MAX_EXPIRY_MS = 60_000
MAX_COUNT = 2**31 - 1
"""Largest numbers of a permit that a box accepts, and of a token, a step, a stamp or a count of the photodiode."""

MAX_SWEEP_PULSES = 10_000
MIN_PERIOD_US = 2000
MAX_PERIOD_US = 10_000_000
"""Most pulses of a sweep, and least and largest time between two of them: each is reported before the next is fired."""

MAX_PULSES_PER_MINUTE = 6000
"""Most pulses that a box sends within any minute, whatever is permitted.

A laser at the usual 100 Hz cannot reach it: 6,000 pulses in a minute are 100 Hz without a pause, and a search moves the
probe in between (16 to 128 pulses an acquisition, a few thousand a minute at most). At 1,000 Hz it is a tenth.
"""

LIGHT_LATE_US = 1000
"""Longest time from a trigger to its light, in microseconds: the photodiode is read, and DONE sent, after it."""

RefusalReason: TypeAlias = Literal[
    "CRC",  # the line came damaged
    "FORM",  # it is no command, or a number is missing, too many, or out of its range
    "TOKEN",  # a permit's token that is not above all before, or a firing without a permit of that token
    "STEP",  # a beat whose step is not above the one before
    "INTERLOCK",  # the interlock is open
    "BUSY",  # a permit or HELLO before a train of triggers has ended
    "BUDGET",  # the permit's pulses would be more than the box sends within a minute
]


Count: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=MAX_COUNT)]
Token: TypeAlias = Annotated[int, msgspec.Meta(ge=1, le=MAX_COUNT)]
Expiry: TypeAlias = Annotated[int, msgspec.Meta(ge=1, le=MAX_EXPIRY_MS)]


class Message(msgspec.Struct, frozen=True):
    """A line of the protocol: its head, then its fields in their order."""

    head: ClassVar[str]


class Hello(Message, frozen=True, kw_only=True):
    """Asks for the identity; voids any permit, and steps may begin at 1 again."""

    head = "HELLO"


class PermitPulses(Message, frozen=True, kw_only=True):
    """Permits a number of pulses at a rate in Hz until an expiry in milliseconds, with a number of triggers in all."""

    head = "PERMIT"
    token: Token
    pulses: Count
    rate_hz: Annotated[int, msgspec.Meta(ge=1, le=MAX_RATE_HZ)]
    expiry_ms: Expiry
    triggers: Annotated[int, msgspec.Meta(ge=1, le=MAX_PULSES)]


class Beat(Message, frozen=True, kw_only=True):
    """Renews the lease; the step is the control loop's own counter."""

    head = "BEAT"
    step: Count


class Fire(Message, frozen=True, kw_only=True):
    """Uses the permit of that token."""

    head = "FIRE"
    token: Count


class PermitSweep(Message, frozen=True, kw_only=True):
    """Permits single pulses with a least time between two, until an expiry in milliseconds."""

    head = "SWEEP"
    token: Token
    pulses: Annotated[int, msgspec.Meta(ge=1, le=MAX_SWEEP_PULSES)]
    period_us: Annotated[int, msgspec.Meta(ge=MIN_PERIOD_US, le=MAX_PERIOD_US)]
    expiry_ms: Expiry


class AskTime(Message, frozen=True, kw_only=True):
    """Asks what the box's clock shows; the number comes back with the answer."""

    head = "TIME"
    number: Count


class Disarm(Message, frozen=True, kw_only=True):
    """Voids any permit, also while it fires."""

    head = "DISARM"


class Greeting(Message, frozen=True, kw_only=True):
    """Answer to `Hello`: identity, version of the protocol, lease in milliseconds, and the last token used.

    ``seen`` is how many pulses of light the photodiode has seen since power-up; ``meter`` is 1 if it measures light.
    """

    head = "OK HELLO"
    identity: Annotated[str, msgspec.Meta(pattern=r"\A[0-9A-Za-z]{1,16}\Z")]
    version: Count
    lease_ms: Count
    last_token: Count
    seen: Count
    meter: Annotated[int, msgspec.Meta(ge=0, le=1)]


class Permitted(Message, frozen=True, kw_only=True):
    """Answer to `PermitPulses`; ``seen`` is how many pulses of light the photodiode has seen since power-up."""

    head = "OK PERMIT"
    token: Count
    seen: Count


class Done(Message, frozen=True, kw_only=True):
    """A train has ended: pulses sent to the laser, pulses that the photodiode saw, and the sum of their light."""

    head = "DONE"
    token: Count
    sent: Count
    photodiode: Count
    light: Count


class SweepPermitted(Message, frozen=True, kw_only=True):
    """Answer to `PermitSweep`, as `Permitted`."""

    head = "OK SWEEP"
    token: Count
    seen: Count


class Stamped(Message, frozen=True, kw_only=True):
    """A pulse of a sweep, counted from 1: when its trigger began, and what the photodiode saw and read of it."""

    head = "PULSE"
    token: Count
    number: Count
    stamp_us: Count
    photodiode: Count
    light: Count


class Dark(Message, frozen=True, kw_only=True):
    """The light of a sweep has ended: pulses sent to the laser, and pulses that the photodiode saw."""

    head = "DARK"
    token: Count
    sent: Count
    photodiode: Count


class Time(Message, frozen=True, kw_only=True):
    """Answer to `AskTime`: its number, and the box's clock in microseconds."""

    head = "OK TIME"
    number: Count
    clock_us: Count


class Disarmed(Message, frozen=True, kw_only=True):
    """Answer to `Disarm`."""

    head = "OK DISARM"


class Refusal(Message, frozen=True, kw_only=True):
    """The command was refused, and any permit is void."""

    head = "ERR"
    reason: RefusalReason


Command: TypeAlias = Hello | PermitPulses | PermitSweep | AskTime | Beat | Fire | Disarm
Reply: TypeAlias = Greeting | Permitted | SweepPermitted | Stamped | Dark | Time | Done | Disarmed | Refusal


def crc16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of the bytes."""
    # CPython's crc_hqx is this polynomial without reflection; only the start value 0xFFFF must be given.
    return binascii.crc_hqx(data, 0xFFFF)


def encode(message: Command | Reply) -> bytes:
    """Return the line of a command or a reply, with its end."""
    # Parsed again before it is sent, so that one set of rules holds for both ends.
    words = _words(message)
    if _parsed(words, (type(message),)) != message:
        raise ConfigError(f"laser box: {message} cannot be sent, a number or word is out of its range")
    text = " ".join(words).encode("ascii")
    return text + b"*%04X\n" % crc16(text)


def decode_command(line: bytes) -> Command | Refusal:
    """Return the command of a line without its end, or the refusal with which a box must answer."""
    text = _checked(line)
    if text is None:
        return Refusal(reason="CRC")
    command: Command | None = _parsed(text.split(" "), get_args(Command))
    return command or Refusal(reason="FORM")


def decode_reply(line: bytes) -> Reply:
    """Return the reply of a line without its end."""
    text = _checked(line)
    reply: Reply | None = None if text is None else _parsed(text.split(" "), get_args(Reply))
    if reply is None:
        what = "damaged (its CRC does not fit)" if text is None else "no reply of a laser box"
        raise LaserError(f"laser box: the line {line[:LINE_BYTES]!r} is {what}; check cable, port and firmware")
    return reply


class Lines:
    """Splits a stream of bytes into lines; a line that is too long comes out empty."""

    def __init__(self) -> None:
        self._rest = b""
        self._too_long = False

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines completed by these bytes, without their ends."""
        *complete, rest = (self._rest + data).split(b"\n")
        # A board whose console ends its lines with CR LF ends ours so, too.
        lines = [b"" if len(line) >= LINE_BYTES else line.removesuffix(b"\r") for line in complete]
        if complete and self._too_long:
            lines[0] = b""
        # The rest is dropped, so that a device that never ends its line cannot fill the memory.
        self._too_long = len(rest) >= LINE_BYTES or (self._too_long and not complete)
        self._rest = b"" if self._too_long else rest
        return lines


def _checked(line: bytes) -> str | None:
    """Return the text of a line whose CRC fits, else None."""
    text, star, crc = line.rpartition(b"*")
    if not star or crc != b"%04X" % crc16(text) or not text.isascii():
        return None
    return text.decode("ascii")


def _words(message: Command | Reply) -> list[str]:
    return [*message.head.split(" "), *map(str, msgspec.structs.astuple(message))]


def _parsed(words: list[str], kinds: tuple[Any, ...]) -> Any | None:
    """Return the message of one of these kinds: its head, then its fields in their order; None for other words."""
    for kind in kinds:
        head = kind.head.split(" ")
        names = kind.__struct_fields__
        if words[: len(head)] == head and len(words) == len(head) + len(names):
            try:
                message = msgspec.convert(dict(zip(names, words[len(head) :], strict=True)), kind, strict=False)
            except msgspec.ValidationError:
                return None
            # A number is written in one way: "007" and "+7" are none.
            return message if _words(message) == words and _fits(message) else None
    return None


def _fits(message: Command | Reply) -> bool:
    """Return whether the numbers of a permit, each in its range, fit one another."""
    match message:
        case PermitPulses():
            # In whole numbers, as the firmware computes it: a division would round differently.
            shortest = 1000 * message.triggers <= message.rate_hz * MAX_EXPIRY_MS
            return message.pulses <= message.triggers and shortest
        case PermitSweep():
            return message.pulses * message.period_us <= 1000 * MAX_EXPIRY_MS
    return True
