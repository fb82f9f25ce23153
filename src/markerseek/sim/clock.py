"""Virtual time: waiting costs nothing, unless a person wants to watch."""

from __future__ import annotations

import math
import time

from markerseek.core import ConfigError

MOST_PACE = 100.0
"""Slowest simulation, in real seconds for a virtual one: a search of five minutes takes a working day."""


class VirtualClock:
    """A clock that jumps.

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

    def put_back(self, now_s: float) -> None:
        """Show another time: that of a world that goes on where it was left."""
        self._now_s = now_s

    def wait(self, duration_s: float) -> None:
        """Jump that many virtual seconds ahead."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        self._now_s += duration_s
        if self._pace > 0:
            time.sleep(duration_s * self._pace)  # noqa: TID251  a person watches: the one place where virtual time is real
