"""How thorough the tests are: ``make test-long`` tries more examples, and checks types and shapes of every call."""

from __future__ import annotations

import os

LONG = os.environ.get("MARKERSEEK_TESTS") == "long"
"""Whether this is the long run."""


def examples(count: int) -> int:
    """Number of examples of a property: all of them in the long run, 25 otherwise."""
    return count if LONG else min(count, 25)
