"""How long each part of a reproduction takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from markerseek.studies.paper.effort import Advance


@dataclass(frozen=True, slots=True, kw_only=True)
class Took:
    """Time that something took.

    Attributes
    ----------
    seconds
        From its begin to its end.
    stages_s
        Seconds of its stages among them, by their names.
    """

    seconds: float
    stages_s: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        stages = [f"{name}: {spent_s:.1f} s" for name, spent_s in self.stages_s.items()]
        rest_s = self.seconds - sum(self.stages_s.values())
        shares = f" ({'; '.join(stages)}; the rest: {rest_s:.1f} s)" if stages else ""
        return f"{self.seconds:.1f} s{shares}"


class Stopwatch:
    """Stands between a work and who watches its progress, and notes when each stage begins and ends.

    Parameters
    ----------
    advance
        Hears of the progress after the watch.
    clock
        Seconds.
    """

    def __init__(self, advance: Advance, *, clock: Callable[[], float] = time.perf_counter) -> None:
        self._advance = advance
        self._clock = clock
        self._since_s = clock()
        self._began_s: dict[str, float] = {}
        self._stages_s: dict[str, float] = {}

    def advance(self, what: str, done: int, total: int) -> None:
        """Note the progress of a stage and pass it on; see `Effort`."""
        now_s = self._clock()
        self._stages_s[what] = now_s - self._began_s.setdefault(what, now_s)
        self._advance(what, done, total)

    def lap(self) -> Took:
        """Time since the watch was made, or since the last lap, and that of the stages since."""
        now_s = self._clock()
        took = Took(seconds=now_s - self._since_s, stages_s=self._stages_s)
        self._since_s, self._began_s, self._stages_s = now_s, {}, {}
        return took
