"""Something that advances evenly, seen at times that are known by two moments: its rate, and whether it has jumped.

A counter is read, or a clock answers, at some moment between a question and its answer. Every two of these bound the
rate, the more closely the longer there is between them; where no rate is left, it has jumped.
"""

from __future__ import annotations

import math
from collections import deque

_KEPT = 256


class Even:
    """What was seen of it: values, each with the earliest and the latest moment at which it had that value.

    ``slowest`` and ``fastest``: least and largest seconds for one unit of the value.
    """

    def __init__(self, *, slowest: float = 0.0, fastest: float = math.inf) -> None:
        self.slowest = slowest
        self.fastest = fastest
        self._seen: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)

    def jump_s(self, value: float, *, earliest_s: float, latest_s: float) -> float:
        """Return the least time by which it has jumped if it has this value between those moments.

        If it is not above 0, it need not have jumped.

        Raises nothing, and keeps nothing.
        """
        jump_s = -math.inf
        for before, before_earliest_s, before_latest_s in self._seen:
            span = value - before
            shortest_s = earliest_s - before_latest_s
            longest_s = latest_s - before_earliest_s
            # A span below 0 takes no time at all.
            most_s = self.fastest * span if span > 0 else 0.0
            jump_s = max(jump_s, shortest_s - most_s, self.slowest * span - longest_s)
        return jump_s

    def add(self, value: float, *, earliest_s: float, latest_s: float) -> None:
        """Keep it; only the last of many are kept."""
        for before, before_earliest_s, before_latest_s in self._seen:
            span = value - before
            if span > 0:
                self.slowest = max(self.slowest, (earliest_s - before_latest_s) / span)
                self.fastest = min(self.fastest, (latest_s - before_earliest_s) / span)
        self._seen.append((value, earliest_s, latest_s))

    def bounds_s(self, value: float, *, slowest: float, fastest: float) -> tuple[float, float]:
        """Return the earliest and latest moment of a value, at rates between those two and by all that was seen."""
        earliest_s = -math.inf
        latest_s = math.inf
        for seen, seen_earliest_s, seen_latest_s in self._seen:
            since_s = [rate * (value - seen) for rate in (slowest, fastest)]
            earliest_s = max(earliest_s, seen_earliest_s + min(since_s))
            latest_s = min(latest_s, seen_latest_s + max(since_s))
        return earliest_s, latest_s
