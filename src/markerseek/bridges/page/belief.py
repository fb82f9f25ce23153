"""What the search believes of the marker's angle, computed again by telling a policy of the page's own.

A stream of events holds what was measured, not what the policy made of it. The same policy, told the same samples,
comes to the same posterior bit for bit (3 to 30 ms a sample).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from markerseek.core import (
    Ambiguous,
    ConfirmablePolicy,
    Estimate,
    Float64,
    Found,
    Interval,
    NotFound,
    PolicyPlan,
    Sample,
    SearchPlan,
)
from markerseek.records import answer_name
from markerseek.search import THRESHOLD, BracketSearch, build, build_sweeping
from markerseek.search.posterior import Posterior, SweepPosterior

ZEROS_DEG = 0.6
"""Width in degrees on both sides of the density that is sent though it is zero there; a pixel of a chart has 0.2."""

_NONE: Float64[np.ndarray, " 0"] = np.empty(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShownBelief:
    """Where the marker is, as far as a search knows."""

    estimate: Estimate
    """The answer that the search would give now."""
    claims: bool = True
    """Whether the method claims anything; the paper's form always answers, and claims nothing."""
    angles_deg: Float64[np.ndarray, " angles"] = field(default_factory=lambda: _NONE)
    density_per_deg: Float64[np.ndarray, " angles"] = field(default_factory=lambda: _NONE)
    """``angles_deg`` and ``density_per_deg``: angles, ascending, and the probability density of the marker there; empty
    for a method without one."""
    bracket_deg: tuple[float, float] | None = None
    """Both ends of the part of the range that is left; None for a method without a bracket."""
    weights: tuple[float, ...] = ()
    """Weight of each sample in a weighted average, 0 to 1; empty for other methods."""
    choice_deg: Float64[np.ndarray, " candidates"] = field(default_factory=lambda: _NONE)
    choice_sigma_deg: Float64[np.ndarray, " candidates"] = field(default_factory=lambda: _NONE)
    """``choice_deg`` and ``choice_sigma_deg``: angles in degrees that were weighed up for the next acquisition, and the
    standard deviation expected after one there; empty for a method that does not weigh them up."""

    @property
    def answer(self) -> str:
        """Name of the answer."""
        return answer_name(self.estimate)

    @property
    def is_found(self) -> bool:
        """Whether it claims a marker."""
        return self.claims and isinstance(self.estimate, Found)

    @property
    def sigma_deg(self) -> float | None:
        """Standard deviation in degrees; None where the answer has none."""
        return None if not self.claims or isinstance(self.estimate, NotFound) else self.estimate.sigma_deg

    @property
    def interval95_deg(self) -> tuple[float, float] | None:
        """95 % interval in degrees; None where the answer has none."""
        interval = None if not self.claims or isinstance(self.estimate, NotFound) else self.estimate.interval95_deg
        return None if interval is None else (interval.low_deg, interval.high_deg)


def angles_text(estimate: Estimate) -> str:
    """Angles that an answer names; empty where nothing was detected, because the angle is then that of the noise."""
    if isinstance(estimate, NotFound):
        return ""
    if isinstance(estimate, Ambiguous):
        return " or ".join(f"{each:.1f}°" for each in estimate.modes_deg)
    return f"{estimate.mean_deg:.3f}°"


def is_claimed(answer: Mapping[str, Any]) -> bool:
    """Whether a search claims its angle; the paper's form of a method answers always and claims nothing."""
    return bool(answer["answer"] == "found" and not answer["as_published"])


def answer_in_words(answer: Mapping[str, Any]) -> str:
    """The answer of a search, with an angle as the command line prints it."""
    if answer["as_published"]:
        return f"angle {answer['angle_deg']:.3f}°, claim: none"
    return f"found at {answer['angle_deg']:.3f}°" if is_claimed(answer) else str(answer["answer"])


class PolicyMirror:
    """A policy that is told what the policy of a running search is told."""

    def __init__(self, plan: SearchPlan, *, limits: Interval) -> None:
        self._policy = build_sweeping(plan, limits=limits)
        self._claims = not plan.as_published
        # The checked form keeps its bracket to itself; the published one, given the same samples, has the same.
        self._bracket: BracketSearch | None = None
        if plan.method != "posterior":
            published = build(
                PolicyPlan(method=plan.method, acquisitions=plan.acquisitions, as_published=True), limits=limits
            )
            self._bracket = published if isinstance(published, BracketSearch) else None
        self._weighted = plan.method == "weighted-average"
        self._intensities: list[float] = []

    def tell(self, sample: Sample) -> None:
        """Take one sample, dark or with light."""
        self._policy.tell(sample)
        if not sample.dark:
            self._intensities.append(sample.reading.intensity)
            if self._bracket is not None:
                self._bracket.tell(sample)

    def confirm(self, sample: Sample) -> None:
        """Take the acquisition at the angle found, where the policy weighs it."""
        if isinstance(self._policy, ConfirmablePolicy):
            self._policy.confirm(sample)

    def belief(self) -> ShownBelief | None:
        """What follows from the samples so far; None before the first with light."""
        if not self._intensities:
            return None
        estimate = self._policy.estimate()
        if isinstance(self._policy, Posterior | SweepPosterior):
            return _posterior_belief(self._policy, estimate)
        bracket = None if self._bracket is None else self._bracket.bracket
        return ShownBelief(
            estimate=estimate,
            claims=self._claims,
            bracket_deg=None if bracket is None else (bracket.low_deg, bracket.high_deg),
            weights=_weights(self._intensities) if self._weighted else (),
        )


def _weights(intensities: list[float]) -> tuple[float, ...]:
    """Share of the largest sample; 0 below the threshold of the method."""
    largest = max(intensities)
    shares = [value / largest if largest > 0 else 1.0 for value in intensities]
    return tuple(share if share >= THRESHOLD else 0.0 for share in shares)


def _posterior_belief(policy: Posterior | SweepPosterior, estimate: Estimate) -> ShownBelief:
    public = policy.belief
    if public is None:
        return ShownBelief(estimate=estimate)
    angles_deg, density = _thinned(public.angles_deg, public.probability / np.diff(public.angles_deg[:2]))
    choice = public.choice
    return ShownBelief(
        estimate=estimate,
        angles_deg=angles_deg,
        density_per_deg=density,
        choice_deg=_NONE if choice is None else choice.angles_deg,
        choice_sigma_deg=_NONE if choice is None else choice.sigma_deg,
    )


def _thinned(
    angles_deg: Float64[np.ndarray, " angles"], density_per_deg: Float64[np.ndarray, " angles"]
) -> tuple[Float64[np.ndarray, " kept"], Float64[np.ndarray, " kept"]]:
    """The density without most of the angles where it is zero: a sharp posterior is zero almost everywhere."""
    seen = density_per_deg > 1e-4 * density_per_deg.max()
    # Zeros for some way beside what is seen: a chart leaves out points that are nearer than a pixel, and a line from
    # the last one that is not zero to the end of the range would look like probability.
    beside = int(np.ceil(ZEROS_DEG / (angles_deg[1] - angles_deg[0])))
    kept = np.convolve(seen, np.ones(2 * beside + 1), mode="same") > 0
    kept[[0, -1]] = True
    return angles_deg[kept], np.where(seen, density_per_deg, 0.0)[kept]
