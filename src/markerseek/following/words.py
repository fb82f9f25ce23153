"""How a follower stands, a word each, and what ends what holds the probe."""

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
"""How it stands: inside the range, or turning, resting between turns or waiting for a target that is back; else why the
probe stays."""

BY_ITSELF: frozenset[Word] = frozenset({"out of reach", "lost", "jumped", "stale"})
"""What ends by itself once the target is back."""

BY_A_PERSON: frozenset[Word] = frozenset(
    {"endoscope", "tissue", "unconfirmed", "heartbeat", "stopped", "expired", "fault"}
)
"""What ends only when a person says so."""
