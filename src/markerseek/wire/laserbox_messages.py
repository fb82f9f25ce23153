"""Messages between a laser box and its host, and the limits of their numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

VERSION = 1
"""Version of the protocol."""

EMULATOR = "emulator"
"""Identity of an emulated box."""

LEASE_MS = 100
"""Longest lease of a box, in milliseconds."""

LINE_BYTES = 80
"""Longest line, its end included."""

MOST_PULSES, MOST_RATE_HZ, MOST_EXPIRY_MS, MOST_COUNT = 1024, 1000, 60_000, 2**31 - 1
"""Largest numbers of a permit that a box accepts, and of a token, a step or a count of the photodiode."""

MOST_PULSES_PER_MINUTE = 6000
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """Asks for the identity; voids any permit, and steps may begin at 1 again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PermitPulses:
    """Permits a number of pulses at a rate in Hz until an expiry in milliseconds, with a number of triggers in all."""

    token: int
    pulses: int
    rate_hz: int
    expiry_ms: int
    triggers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """Renews the lease; the step is the control loop's own counter."""

    step: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Fire:
    """Uses the permit of that token."""

    token: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Disarm:
    """Voids any permit, also while it fires."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Greeting:
    """Answer to `Hello`: identity, version of the protocol, lease in milliseconds, and the last token used.

    ``seen`` is how many pulses of light the photodiode has seen since power-up.
    """

    identity: str
    version: int
    lease_ms: int
    last_token: int
    seen: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Permitted:
    """Answer to `PermitPulses`; ``seen`` is how many pulses of light the photodiode has seen since power-up."""

    token: int
    seen: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """A train has ended: pulses sent to the laser, and pulses that the photodiode saw."""

    token: int
    sent: int
    photodiode: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Disarmed:
    """Answer to `Disarm`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """The command was refused, and any permit is void."""

    reason: RefusalReason


Command: TypeAlias = Hello | PermitPulses | Beat | Fire | Disarm
Reply: TypeAlias = Greeting | Permitted | Done | Disarmed | Refusal
