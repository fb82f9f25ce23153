"""Means, shares and their 95 % intervals: Student's t for a mean, Clopper and Pearson (1934) for a share."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.special import betaincinv, stdtrit

CONFIDENCE = 0.95
"""Probability that an interval covers the true value."""


class Mean(msgspec.Struct, frozen=True, kw_only=True):
    """A mean with its 95 % interval, and the standard deviation of one value; None if there are too few."""

    count: int
    mean: float | None
    interval95: tuple[float, float] | None
    sd: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Mean:
        """Mean of a sample."""
        count = len(values)
        mean = float(np.mean(values)) if count else None
        if mean is None or count < 2:
            return cls(count=count, mean=mean, interval95=None, sd=None)
        sd = float(np.std(values, ddof=1))
        # The quantile itself: `scipy.stats.t` gives the same and takes 0.4 s to import.
        half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * sd / math.sqrt(count)
        return cls(count=count, mean=mean, interval95=(mean - half, mean + half), sd=sd)

    @property
    def half(self) -> float | None:
        """Half the width of the interval; None for fewer than two values."""
        return None if self.interval95 is None else (self.interval95[1] - self.interval95[0]) / 2


class Share(msgspec.Struct, frozen=True, kw_only=True):
    """Hits over trials, with the 95 % interval of the probability; None without trials."""

    hits: int
    count: int
    share: float | None
    interval95: tuple[float, float] | None

    @classmethod
    def of(cls, hits: int, count: int) -> Share:
        """Share of hits."""
        if count == 0:
            return cls(hits=0, count=0, share=None, interval95=None)
        return cls(hits=hits, count=count, share=hits / count, interval95=clopper_pearson(hits, count))


def clopper_pearson(hits: int, count: int) -> tuple[float, float]:
    """Exact 95 % interval of the probability of a hit."""
    # The quantiles of the beta distribution themselves. `scipy.stats.binomtest` searches for the same limits with an
    # absolute tolerance of 2e-12, and importing it takes 0.4 s, in each worker of a study.
    tail = (1 - CONFIDENCE) / 2
    # The beta distribution has no parameter 0: without hits, or with hits only, the limit is 0 or 1 itself.
    low = 0.0 if hits == 0 else float(betaincinv(hits, count - hits + 1, tail))
    high = 1.0 if hits == count else float(betaincinv(hits + 1, count - hits, 1 - tail))
    return low, high
