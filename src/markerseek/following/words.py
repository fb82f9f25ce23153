"""The states of a follower, one word each, and what ends those in which the probe stays where it is."""

from __future__ import annotations

from typing import Literal, TypeAlias

Word: TypeAlias = Literal[
    "there",
    "turning",
    "resting",
    "waiting",
    "out of reach",
    "lost",
    "jumped",
    "stale",
    "endoscope",
    "tissue",
    "unconfirmed",
    "heartbeat",
    "stopped",
    "expired",
    "fault",
]
"""State of a follower: the target is in the range, or the probe turns, rests between turns or waits for a target that
is back; else why the probe stays where it is."""

BY_ITSELF: frozenset[Word] = frozenset({"out of reach", "lost", "jumped", "stale"})
"""States that end by themselves once the target is back."""

BY_A_PERSON: frozenset[Word] = frozenset(
    {"endoscope", "tissue", "unconfirmed", "heartbeat", "stopped", "expired", "fault"}
)
"""States that only a person ends."""
