"""Golden-section and ternary search: one search, two ratios (section 2.3 of the paper).

Two inner points are compared, and the part of the bracket beyond the weaker one is dropped:

    θm1 = r·θl + (1 − r)·θr                                                              (3)
    θm2 = (1 − r)·θl + r·θr                                                              (4)

with r = (√5 − 1)/2 for the golden section (2) and r = 2/3 for the ternary search. The paper prints r = 1/3 for the
latter, which would swap the two inner points; the search that is meant keeps two thirds of the bracket.

The paper measures both points again in every iteration, left one first. The textbook's golden section keeps the point
that lies in the new bracket and measures one.

**Angles reached.** The stage does not stop exactly at the commanded angle. Points lie at the angles of the samples:
of the two, the one at the lower angle is the left one, and the bracket is cut at the angle reached. On a unimodal curve
S(a) ≥ S(b) with a < b leaves the maximum below b wherever a and b lie, so the cut holds for any pair. A cut that would
leave nothing contradicts earlier samples, and is not made.
"""

from __future__ import annotations

import math

from markerseek.core import PAPER_RANGE, ConfigError, Found, Interval, Sample
from markerseek.search.curve import Curve, curve_of, noise_limit_deg
from markerseek.search.policy import SearchPolicy, check_acquisitions

GOLDEN = (math.sqrt(5) - 1) / 2
"""Ratio of the golden section, eq. (2)."""

TERNARY = 2 / 3
"""Ratio of the ternary search."""


class BracketSearch(SearchPolicy):
    """Narrows a bracket round the maximum of a unimodal curve.

    Ties go left: where both points are equally strong, the right part is dropped (the paper's ≥). An odd number of
    acquisitions leaves one without a partner; it is not made, and one fewer is reported. On a flat curve all ties go
    left and the answer is the low end of the range.

    Parameters
    ----------
    ratio
        Share r of the bracket that is kept, above 1/2 and below 1: `GOLDEN` or `TERNARY`.
    limits
        Range to search, the first bracket.
    acquisitions
        Most acquisitions.
    reuse
        Keep the inner point that lies in the new bracket, as textbooks do: golden section only.

    Raises
    ------
    ConfigError
        If the ratio is outside (1/2, 1), fewer than 2 acquisitions are allowed, or the kept point of a ratio other than
        the golden one is to be reused.
    """

    name = "bracket search"

    def __init__(
        self,
        *,
        ratio: float,
        limits: Interval = PAPER_RANGE,
        acquisitions: int,
        reuse: bool = False,
    ) -> None:
        super().__init__()
        if not 0.5 < ratio < 1:
            raise ConfigError(
                f"bracket search: ratio is {ratio:g}, it must lie above 1/2 and below 1 "
                "(r = 1/3 swaps the inner points; the ternary search has r = 2/3)"
            )
        if reuse and not math.isclose(ratio, GOLDEN):
            raise ConfigError(
                f"bracket search: with ratio {ratio:g} the kept point is not an inner point of the next bracket; "
                "reuse it with the golden ratio only"
            )
        check_acquisitions(acquisitions, least=self.least, method=self.name)
        self._ratio = ratio
        self._limits = limits
        self._low_deg = limits.low_deg
        self._high_deg = limits.high_deg
        self._budget = acquisitions if reuse else acquisitions - acquisitions % 2
        self._reuse = reuse
        self._kept: tuple[Sample, bool] | None = None

    @property
    def bracket(self) -> Interval:
        """Part of the range that is left, [θl, θr]."""
        return Interval(low_deg=self._low_deg, high_deg=self._high_deg)

    def _next_deg(self) -> float | None:
        """Return the next inner point in degrees, the left one of a new pair first; None at the end."""
        if len(self._lit) >= self._budget:
            return None
        left = self._kept is None or not self._kept[1]
        share = self._ratio if left else 1 - self._ratio
        angle_deg = share * self._low_deg + (1 - share) * self._high_deg  # (3), (4)
        # Rounding may carry the sum of two shares past an end by one unit in the last place.
        return min(max(angle_deg, self._low_deg), self._high_deg)

    def _update(self, sample: Sample) -> None:
        if self._kept is None:
            self._kept = (sample, True)
            return
        # By the angles reached: a stage may have swapped two angles that lie close together.
        left, right = sorted((self._kept[0], sample), key=lambda point: point.angle_deg)
        self._kept = self._cut(left, right)

    def _cut(self, left: Sample, right: Sample) -> tuple[Sample, bool] | None:
        """Drop what lies beyond the weaker point; return the point that is kept and whether it becomes the left one."""
        # Two samples at one angle (of a stage that cannot resolve the two inner points) say nothing of either side.
        if left.angle_deg == right.angle_deg:
            return None
        if left.reading.intensity >= right.reading.intensity:
            high_deg = min(self._high_deg, right.angle_deg)
            if high_deg > self._low_deg:
                self._high_deg = high_deg
            return (left, False) if self._reuse else None
        low_deg = max(self._low_deg, left.angle_deg)
        if low_deg < self._high_deg:
            self._low_deg = low_deg
        return (right, True) if self._reuse else None

    def estimate(self) -> Found:
        """Return the middle of the bracket, (θl + θr)/2, with the bracket as its interval."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Return the middle of the bracket, with its width and what the noise hides as uncertainty.

        A comparison near the maximum is decided by noise once the two points differ by less than it, so that the
        bracket of a long search is far too narrow. With σ known, the standard deviation holds besides width/√12 what
        `noise_limit_deg` says of the curve.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity, in the intensity's unit; None: the bracket alone.
        """
        return bracket_answer(self.bracket.centre_deg, self.bracket, curve_of(self._lit), noise_sigma=noise_sigma)


def bracket_answer(mean_deg: float, bracket: Interval, curve: Curve, *, noise_sigma: float | None) -> Found:
    """Return the answer of a search that ends with a bracket: sigma width/√12, and with known σ what the noise hides.

    ``mean_deg``: angle that the search answers with, inside the bracket. ``curve``: the samples so far.
    ``noise_sigma``: standard deviation of the intensity, in the intensity's unit; None: the bracket alone.
    """
    sigma_deg = bracket.width_deg / math.sqrt(12)
    interval = bracket
    if noise_sigma and len(curve):
        sigma_deg = math.hypot(sigma_deg, noise_limit_deg(curve, noise_sigma=noise_sigma))
        interval = Interval(
            low_deg=min(bracket.low_deg, mean_deg - 1.96 * sigma_deg),
            high_deg=max(bracket.high_deg, mean_deg + 1.96 * sigma_deg),
        )
    return Found(mean_deg=mean_deg, sigma_deg=sigma_deg, interval95_deg=interval, interval_kind="bracket")


class GoldenSection(BracketSearch):
    """Golden-section search with two fresh acquisitions per iteration, as in the paper."""

    name = "golden-section"
    summary = "golden-section search with two fresh acquisitions per iteration, as in the paper"
    acquisitions = 28

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int) -> None:
        super().__init__(ratio=GOLDEN, limits=limits, acquisitions=acquisitions)


class GoldenSectionReuse(BracketSearch):
    """Golden-section search that keeps the inner point which lies in the new bracket, as in textbooks."""

    name = "golden-section-reuse"
    summary = "golden-section search that keeps the point it can use again, as in textbooks"
    acquisitions = 16

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int) -> None:
        super().__init__(ratio=GOLDEN, limits=limits, acquisitions=acquisitions, reuse=True)


class TernarySearch(BracketSearch):
    """Ternary search with two fresh acquisitions per iteration, as in the paper."""

    name = "ternary"
    summary = "ternary search with two fresh acquisitions per iteration, as in the paper"
    acquisitions = 28

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int) -> None:
        super().__init__(ratio=TERNARY, limits=limits, acquisitions=acquisitions)
