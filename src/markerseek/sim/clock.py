"""Virtual time: waiting takes no real time, unless a pace is set for someone who watches."""

from __future__ import annotations

import math
import time

from markerseek.core import ConfigError

MOST_PACE = 100.0
"""Slowest simulation, in real seconds for a virtual one: a search of five minutes takes a working day."""


class VirtualClock:
    """A clock that a wait sets forward.

    Parameters
    ----------
    pace
        Real seconds that a virtual second takes; 0 takes none, 1 runs at real speed; at most `MOST_PACE`.
    """

    def __init__(self, *, pace: float = 0.0) -> None:
        if not 0 <= pace <= MOST_PACE:
            raise ConfigError(
                f"pace is {pace}, it must lie between 0 (does not wait) and {MOST_PACE:g}; 1 is real speed"
            )
        self._pace = pace
        self._now_s = 0.0

    def now_s(self) -> float:
        """Virtual seconds since the clock was made."""
        return self._now_s

    def set(self, now_s: float) -> None:
        """Set the time, when a simulated rig is restored."""
        self._now_s = now_s

    def wait(self, duration_s: float) -> None:
        """Jump that many virtual seconds ahead."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        self._now_s += duration_s
        # Without a pace no sleep at all: even one of 0 s gives the processor away.
        if self._pace > 0:
            time.sleep(duration_s * self._pace)  # noqa: TID251  the only place where virtual time takes real time
