"""The watchdog's lease: steps of the control loop renew it, and time alone never does."""

import math

from markerseek.core import is_finite, is_whole, require_range


class Lease:
    """Lapses when no step of the control loop comes for ``period_s``, in (0, 1] s: one without would never end."""

    def __init__(self, *, period_s: float) -> None:
        require_range("lease: period_s", period_s, low=0, high=1, unit="s", open_low=True)
        self._period_s = period_s
        self._step = 0
        self._ends_s: float | None = None

    @property
    def ends_s(self) -> float | None:
        """When it lapses unless it is renewed, in seconds; None while it is not held."""
        return self._ends_s

    def hold(self, *, now_s: float) -> None:
        """Require steps from now on; an existing lease is not renewed. It lapses if ``now_s`` is not a number."""
        if self._ends_s is None:
            self._ends_s = (now_s if is_finite(now_s) else -math.inf) + self._period_s

    def beat(self, step: int, *, now_s: float) -> None:
        """Renew it by a step above all before, from 1 on; a lapsed lease stays lapsed until `release`."""
        # A loop that repeats its last step hangs: only a step above all before shows progress.
        if is_whole(step) and step > self._step:
            self._step = step
            if self._ends_s is not None and not self.lapsed(now_s=now_s):
                self._ends_s = now_s + self._period_s

    def lapsed(self, *, now_s: float) -> bool:
        """Return whether steps are required and none came in time."""
        return self._ends_s is not None and not (is_finite(now_s) and now_s <= self._ends_s)

    def release(self) -> None:
        """Require no more steps; allowed at any time, also twice."""
        self._ends_s = None
