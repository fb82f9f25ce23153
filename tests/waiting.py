"""Waiting for what another thread or process does; a test never waits for a time to pass."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

LONGEST_S = 60.0
"""Time after which what is waited for does not come; a busy computer is slow."""


def wait_until(holds: Callable[[], object], *, every_s: float = 0.01) -> None:
    """Return once a condition holds; fail if it does not hold in time."""
    ends_s = time.monotonic() + LONGEST_S
    looked = threading.Event()
    while not holds():
        assert time.monotonic() < ends_s, "what the test waits for did not come"
        looked.wait(every_s)
