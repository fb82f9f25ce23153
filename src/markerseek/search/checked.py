"""A published method that answers `Found` only where its samples prove a marker: the form that users get.

A method as published always answers. Checked, it also takes dark samples, and its answer passes four tests in turn:

1. evidence (`missing_evidence`): above the noise floor, not flat, from one place in the image → else `NotFound`;
2. the intensity falls again before either end of the range (`rising_side`) → else `AtBound`;
3. the answer fits the samples (`contradiction`) → else `Unsure`;
4. the standard deviation is at most 0.25° (promise P10) → else `Unsure`.

What passes is `Found` with the method's own angle, and with the noise that was measured in its uncertainty.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from markerseek.core import PAPER_RANGE, AtBound, ConfigError, Estimate, Found, Interval, NotFound, Sample
from markerseek.search.curve import curve_of
from markerseek.search.evidence import contradiction, missing_evidence, rising_side
from markerseek.search.floor import noise_of
from markerseek.search.policy import PublishedPolicy, SearchPolicy
from markerseek.search.sweep import peak_passed

SIGMA_LIMIT_DEG = 0.25
"""Largest standard deviation of an angle that is called found, in degrees (promise P10)."""


class CheckedPolicy(SearchPolicy):
    """A published policy whose answer must pass the four tests.

    Parameters
    ----------
    inner
        The method as published; a weighted average without its own early end.
    limits
        Range that it searches.
    early_threshold
        End once the peak is recorded and passed at this share of the largest sample and the evidence holds; None: do
        not end early. Unlike the published early end this one never ends a search in mere noise.
    sigma_limit_deg
        Largest standard deviation of a `Found`, in degrees.

    Raises
    ------
    ConfigError
        If ``sigma_limit_deg`` is not positive.
    """

    name = "checked search"

    def __init__(
        self,
        inner: PublishedPolicy,
        *,
        limits: Interval = PAPER_RANGE,
        early_threshold: float | None = None,
        sigma_limit_deg: float = SIGMA_LIMIT_DEG,
    ) -> None:
        super().__init__()
        if not sigma_limit_deg > 0:
            raise ConfigError(f"checked search: sigma_limit_deg is {sigma_limit_deg} deg, it must be positive")
        self._inner = inner
        self._limits = limits
        self._early_threshold = early_threshold
        self._sigma_limit_deg = sigma_limit_deg

    def _next_deg(self) -> float | None:
        """Next angle of the method in degrees; None at its end."""
        if self._early_threshold is not None:
            intensity = np.array([sample.reading.intensity for sample in self._lit], dtype=np.float64)
            if peak_passed(intensity, threshold=self._early_threshold) and self._missing_evidence() is None:
                return None
        return self._inner.ask()

    def _update(self, sample: Sample) -> None:
        self._inner.tell(sample)

    def _missing_evidence(self) -> str | None:
        return missing_evidence(self._lit, dark=self._dark, noise=noise_of(self._lit, dark=self._dark))

    def estimate(self) -> Estimate:
        """Answer as far as the samples prove it; `NotFound` before the first."""
        noise = noise_of(self._lit, dark=self._dark)
        answer = self._inner.answer(noise_sigma=noise.sigma)
        reason = missing_evidence(self._lit, dark=self._dark, noise=noise)
        if reason is not None:
            return NotFound(mean_deg=answer.mean_deg, reason=reason, floor=noise.floor)
        side = self._rising_side()
        if side is not None:
            curve = curve_of(self._lit)
            top_deg = float(curve.angle_deg[curve.strongest])
            # The stage may stop up to a count beyond the end; the answer is inside the range.
            return AtBound(mean_deg=self._limits.nearest(top_deg), side=side, floor=noise.floor)
        doubt = contradiction(self._lit, mean_deg=answer.mean_deg, noise=noise) or self._too_wide(answer)
        found = replace(answer, floor=noise.floor)
        return found if doubt is None else found.doubted(doubt)

    def _rising_side(self) -> Literal["low", "high"] | None:
        """The end at which the curve rises; of a bracket only once it is narrow, because it begins at both ends."""
        # The answer without noise: with noise the interval is wider, and the bracket the same.
        bare = self._inner.estimate()
        if bare.interval_kind == "bracket" and bare.sigma_deg > self._sigma_limit_deg:
            return None
        return rising_side(self._lit, answer=bare, limits=self._limits)

    def _too_wide(self, answer: Found) -> str | None:
        if answer.sigma_deg <= self._sigma_limit_deg:
            return None
        return (
            f"the standard deviation, {answer.sigma_deg:.2f} deg, is above {self._sigma_limit_deg:g} deg; "
            "more acquisitions, or more pulses in each, reduce it"
        )
