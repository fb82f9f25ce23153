"""What a laser box and its host say to one another, and the largest numbers of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

VERSION = 1
"""Version of the protocol."""

LEASE_MS = 100
"""Longest lease of a box, in milliseconds."""

LINE_BYTES = 80
"""Longest line, its end included."""

MOST_PULSES, MOST_RATE_HZ, MOST_EXPIRY_MS, MOST_COUNT = 1024, 1000, 60_000, 2**31 - 1
"""Largest numbers of a permit that a box accepts, and of a token or step."""

RefusalReason: TypeAlias = Literal[
    "CRC",  # the line came damaged
    "FORM",  # it is no command, or a number is missing, too many, or out of its range
    "TOKEN",  # a permit's token that is not above all before, or a firing without a permit of that token
    "STEP",  # a beat whose step is not above the one before
    "INTERLOCK",  # the interlock is open
    "BUSY",  # a permit while pulses are fired
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Hello:
    """Asks who is there; takes any permit away and begins the steps anew."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PermitPulses:
    """Leave for at most so many pulses, at a rate in Hz, for so many milliseconds, with so many triggers in all."""

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
    """Takes any permit away, also while it fires."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Greeting:
    """Answer to `Hello`: who is there, its protocol, its lease in milliseconds, and the last token that it took."""

    identity: str
    version: int
    lease_ms: int
    last_token: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Permitted:
    """Answer to `PermitPulses`."""

    token: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """A firing is over: pulses sent to the laser, and pulses that the photodiode saw."""

    token: int
    sent: int
    photodiode: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Disarmed:
    """Answer to `Disarm`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """Nothing was done, and any permit is gone."""

    reason: RefusalReason


Command: TypeAlias = Hello | PermitPulses | Beat | Fire | Disarm
Reply: TypeAlias = Greeting | Permitted | Done | Disarmed | Refusal
