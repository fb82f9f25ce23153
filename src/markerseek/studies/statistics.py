"""Means, shares and their 95 % intervals: Student's t for a mean, Clopper and Pearson (1934) for a share.

`Moments` are merged with the formula of T. F. Chan, G. H. Golub and R. J. LeVeque (1979), so that memory does not grow
with the sample.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.special import betaincinv, stdtrit

CONFIDENCE = 0.95
"""Probability that an interval covers the true value."""


class Moments(msgspec.Struct, frozen=True, kw_only=True):
    """Number, mean and sum of squared differences from the mean of a sample."""

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, values: Sequence[float]) -> Moments:
        """Moments of these values."""
        if not values:
            return cls()
        # Two passes: with the sum of squares alone, digits would cancel.
        mean = float(np.mean(values))
        return cls(count=len(values), mean=mean, squares=float(np.sum((np.asarray(values) - mean) ** 2)))

    def merged(self, other: Moments) -> Moments:
        """Moments of both samples together."""
        count = self.count + other.count
        if count == 0:
            return self
        # Difference of the means, not sums of squares: those of large samples would cancel.
        apart = other.mean - self.mean
        return Moments(
            count=count,
            mean=self.mean + apart * other.count / count,
            squares=self.squares + other.squares + apart**2 * self.count * other.count / count,
        )

    @property
    def sd(self) -> float | None:
        """Standard deviation of a value, with n − 1; None for fewer than two."""
        return math.sqrt(self.squares / (self.count - 1)) if self.count > 1 else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Interval of the mean, by Student's t; None for fewer than two."""
        if self.sd is None:
            return None
        # The quantile itself: `scipy.stats.t` gives the same and takes 0.4 s to import.
        half = float(stdtrit(self.count - 1, (1 + CONFIDENCE) / 2)) * self.sd / math.sqrt(self.count)
        return self.mean - half, self.mean + half


class Mean(msgspec.Struct, frozen=True, kw_only=True):
    """A mean with its 95 % interval, and the standard deviation of one value; None where there are too few."""

    count: int
    mean: float | None
    interval95: tuple[float, float] | None
    sd: float | None

    @classmethod
    def of(cls, moments: Moments) -> Mean:
        """Mean of a sample with these moments."""
        mean = moments.mean if moments.count else None
        return cls(count=moments.count, mean=mean, interval95=moments.interval, sd=moments.sd)


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
