"""What a paced search needs for itself between two questions: what watchers of it must not lengthen."""

from __future__ import annotations

from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from markerseek.core import Asked
from markerseek.records.journal import read_journal

PACE = 0.02
"""Real seconds for a second of the rig: a search of two minutes takes three seconds."""


def own_times_s(journal: Path) -> list[float]:
    """Time from one question of a paced search to the next, without what the rig's clock takes, in seconds."""
    asked = [each for each in read_journal(journal, frames=False).entries if isinstance(each.event, Asked)]
    at = [(datetime.fromisoformat(each.written).timestamp(), each.clock_s) for each in asked]
    steps = [(end[0] - begin[0]) - PACE * (end[1] - begin[1]) for begin, end in pairwise(at)]
    # The first question loads the posterior's kernels.
    return steps[1:]


def described(values: list[float]) -> str:
    """Median, 99th percentile and largest value in milliseconds."""
    p50, p99 = np.percentile(values, [50, 99])
    return f"median {1e3 * p50:.0f} ms, p99 {1e3 * p99:.0f} ms, largest {1e3 * max(values):.0f} ms, n = {len(values)}"
