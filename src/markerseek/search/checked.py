"""A published method that answers `Found` only where its samples prove a marker: the form that users get.

A method as published always answers. Checked, it also takes dark samples, and its answer passes four tests in turn:

1. evidence (`why_not_detected`): above the detection threshold, not flat, from one place in the image → else
   `NotFound`;
2. the intensity falls again before either end of the range (`rising_side`) → else `AtBound`;
3. the answer fits the samples (`inconsistency`) → else `Unsure`;
4. the interval lies within the tolerance of the angle → else `Unsure`, for its width.

What passes is `Found` with the method's own angle, and with the noise that was measured in its uncertainty.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec.structs import replace

from markerseek.core import PAPER_RANGE, AtBound, Estimate, Interval, NotFound, Sample, Tolerance
from markerseek.search.curve import curve_of
from markerseek.search.evidence import (
    KNOWN_SIGMA_DEG,
    beyond_tolerance,
    inconsistency,
    marker_radius_m,
    rising_side,
    why_not_detected,
    with_half_width,
)
from markerseek.search.floor import above_background, noise_above_background
from markerseek.search.policy import PaperPolicy, SearchPolicy
from markerseek.search.steps import peak_passed

_USUAL = Tolerance()


class CheckedPolicy(SearchPolicy):
    """A published policy whose answer must pass the four tests.

    Parameters
    ----------
    inner
        The method as published; a weighted average without its own early end.
    limits
        Range that it searches.
    early_end
        End once the peak is recorded and passed (`peak_passed`) and the evidence holds. Unlike the published early end
        this one never ends a search in mere noise.
    tolerance
        How well the angle of a `Found` must be known.
    """

    name = "checked search"

    def __init__(
        self,
        inner: PaperPolicy,
        *,
        limits: Interval = PAPER_RANGE,
        early_end: bool = False,
        tolerance: Tolerance = _USUAL,
    ) -> None:
        super().__init__()
        self.inner = inner
        self._limits = limits
        self._early_end = early_end
        self._tolerance = tolerance

    def _next_deg(self) -> float | None:
        """Return the next angle of the method in degrees; None at its end."""
        intensity = np.array([sample.reading.intensity for sample in self._lit], dtype=np.float64)
        if self._early_end and peak_passed(intensity):
            noise = noise_above_background(self._lit, dark=self._dark)
            lit = above_background(self._lit, noise.background)
            if why_not_detected(lit, dark=self._dark, noise=noise) is None:
                return None
        return self.inner.ask()

    def _update(self, sample: Sample) -> None:
        self.inner.tell(sample)

    def estimate(self) -> Estimate:
        """Return the answer as far as the samples prove it; `NotFound` before the first."""
        noise = noise_above_background(self._lit, dark=self._dark)
        floor = noise.measured_floor
        lit = above_background(self._lit, noise.background)
        answer = self.inner.answer(noise_sigma=noise.sigma)
        reason = why_not_detected(lit, dark=self._dark, noise=noise)
        if reason is not None:
            return NotFound(mean_deg=answer.mean_deg, reason=reason, floor=floor)
        side = self._rising_side()
        if side is not None:
            curve = curve_of(self._lit)
            top_deg = float(curve.angle_deg[curve.strongest])
            # The stage may stop up to a count beyond the end; the answer is inside the range.
            return AtBound(mean_deg=self._limits.nearest(top_deg), side=side, floor=floor)
        radius_m = marker_radius_m(self._lit)
        found = with_half_width(replace(answer, floor=floor), radius_m=radius_m)
        inconsistent = inconsistency(lit, mean_deg=answer.mean_deg, noise=noise)
        if inconsistent is not None:
            return found.as_unsure("source", inconsistent)
        too_wide = beyond_tolerance(found, self._tolerance, radius_m=radius_m)
        if too_wide is None:
            return found
        return found.as_unsure("width", f"{too_wide}; more acquisitions, or more pulses in each, reduce it")

    def _rising_side(self) -> Literal["low", "high"] | None:
        """Return the end at which the curve rises; a bracket begins at both ends, and counts only once it is narrow."""
        # The answer without noise: with noise the interval is wider, and the bracket the same.
        bare = self.inner.estimate()
        if bare.interval_kind == "bracket" and bare.sigma_deg > KNOWN_SIGMA_DEG:
            return None
        return rising_side(self._lit, answer=bare, limits=self._limits)
