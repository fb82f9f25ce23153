"""Virtual time: waiting takes no real time, unless a pace is set for someone who watches."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from markerseek.core import ConfigError, require_pace

_SLICE_S = 0.02
"""Longest real time between two beats of a wait, in seconds."""


class VirtualClock:
    """A clock that a wait sets forward.

    ``pace``: real seconds that a virtual second takes; 0 takes none, 1 runs at real speed; at most `MAX_PACE`.
    ``beat``: called in each wait, and every 20 ms of real time; None calls nothing.
    """

    def __init__(self, *, pace: float = 0.0, beat: Callable[[], None] | None = None) -> None:
        require_pace(pace)
        self._pace = pace
        self._beat = beat
        self._now_s = 0.0

    def now_s(self) -> float:
        """Virtual seconds since the clock was made."""
        return self._now_s

    def wait(self, duration_s: float) -> None:
        """Jump that many virtual seconds ahead."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        if self._beat is not None:
            self._wait_with_beats(duration_s, self._beat)
            return
        self._now_s += duration_s
        # Without a pace no sleep at all: even one of 0 s gives the processor away.
        if self._pace > 0:
            time.sleep(duration_s * self._pace)  # noqa: TID251  only here and below does virtual time take real time

    def _wait_with_beats(self, duration_s: float, beat: Callable[[], None]) -> None:
        began_s, ends_s = self._now_s, time.monotonic() + duration_s * self._pace
        beat()
        while (left_s := ends_s - time.monotonic()) > 0:
            # A beat may end the wait by an exception: the time is then that of the moment.
            self._now_s = began_s + duration_s - left_s / self._pace
            time.sleep(min(left_s, _SLICE_S))  # noqa: TID251  as above
            beat()
        self._now_s = began_s + duration_s
