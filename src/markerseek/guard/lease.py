"""The dead man's lease: it is renewed by steps of the control loop, never by time going by."""

from __future__ import annotations

import math

from markerseek.core import ConfigError, is_finite, is_whole


class Lease:
    """Holds while the control loop steps on.

    Parameters
    ----------
    period_s
        Longest silence between two steps, in (0, 1] s: a lease without a period would never end.
    """

    def __init__(self, *, period_s: float) -> None:
        if not (is_finite(period_s) and 0 < period_s <= 1):
            raise ConfigError(f"lease: period_s is {period_s} s, it must lie in (0, 1] s")
        self._period_s = period_s
        self._step = 0
        self._ends_s: float | None = None

    @property
    def ends_s(self) -> float | None:
        """When it lapses unless it is renewed, in seconds; None while it is not held."""
        return self._ends_s

    def hold(self, *, now_s: float) -> None:
        """Begin to need steps; holding what is held renews nothing. A time that is no number has lapsed already."""
        if self._ends_s is None:
            self._ends_s = (now_s if is_finite(now_s) else -math.inf) + self._period_s

    def beat(self, step: int, *, now_s: float) -> None:
        """Renew it by a step above all before, from 1 on; one that has lapsed stays so until `release`."""
        if is_whole(step) and step > self._step:
            self._step = step
            if self._ends_s is not None and not self.lapsed(now_s=now_s):
                self._ends_s = now_s + self._period_s

    def lapsed(self, *, now_s: float) -> bool:
        """Whether it is held and no step came in time."""
        return self._ends_s is not None and not (is_finite(now_s) and now_s <= self._ends_s)

    def release(self) -> None:
        """Need no more steps; allowed at any time, also twice."""
        self._ends_s = None
