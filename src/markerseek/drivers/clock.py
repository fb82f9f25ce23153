"""Real time."""

from __future__ import annotations

import math
import time

from markerseek.core import ConfigError


class SystemClock:
    """The computer's steady clock, which no change of the date moves."""

    def now_s(self) -> float:
        """Seconds since some fixed moment; never runs backwards."""
        return time.monotonic()

    def wait(self, duration_s: float) -> None:
        """Sleep for that many seconds."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        time.sleep(duration_s)  # noqa: TID251  the one clock that is real
