"""The clock of a real rig."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

from markerseek.core import Clock, ConfigError

LONGEST_WAIT_S = 0.02
"""Longest time between two beats of a clock that waits, in seconds."""


def polls(clock: Clock, *, within_s: float, every_s: float) -> Iterator[None]:
    """Look at a device until a deadline, at least once; the clock waits between two looks."""
    ends_s = clock.now_s() + within_s
    while True:
        yield
        if not clock.now_s() <= ends_s:
            return
        clock.wait(every_s)


class SystemClock:
    """The computer's monotonic clock, which does not follow changes of the date.

    ``beat``: called at least every `LONGEST_WAIT_S` seconds of a wait, in the caller's own thread: a lease is renewed
    here, so that a control loop that hangs renews nothing.
    """

    def __init__(self, *, beat: Callable[[], None] | None = None) -> None:
        self._beat = beat

    def now_s(self) -> float:
        """Return the seconds since some fixed moment; never runs backwards."""
        return time.monotonic()

    def wait(self, duration_s: float) -> None:
        """Sleep for that many seconds, in slices with a beat before each and after the last."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        if self._beat is None:
            # A sleep of 0 s gives the processor away: on a busy computer for milliseconds.
            if duration_s > 0:
                time.sleep(duration_s)  # noqa: TID251  the one clock that is real
            return
        # A wait has an end and so is a step of the loop; the beat must never move into a timer thread.
        ends_s = self.now_s() + duration_s
        self._beat()
        while (left_s := ends_s - self.now_s()) > 0:
            time.sleep(min(left_s, LONGEST_WAIT_S))  # noqa: TID251  the one clock that is real
            self._beat()
