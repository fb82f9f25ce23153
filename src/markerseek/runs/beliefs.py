"""Puts what the policy believes into the events of a run, so that its record explains itself (decision 53)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from markerseek.core import AngleBelief, AnyPolicy, Asked, Event, Finished, Float64, Measured, SearchPlan
from markerseek.search import THRESHOLD, BracketSearch, CheckedPolicy
from markerseek.search.posterior import Posterior, SweepPosterior

ZEROS_DEG = 0.6
"""Width in degrees on both sides of the density that is kept though it is zero there; a pixel of a chart has 0.2."""


class Beliefs:
    """What a policy believes whenever it asks."""

    def __init__(self, policy: AnyPolicy, plan: SearchPlan) -> None:
        self._policy, self._plan = policy, plan
        self._intensities: list[float] = []

    def added(self, event: Event) -> Event:
        """The event, with the belief of the policy if it asks or has finished."""
        if isinstance(event, Measured) and event.role == "search":
            self._intensities.append(event.sample.reading.intensity)
        if not self._intensities or not isinstance(event, Asked | Finished):
            return event
        belief = self._belief()
        # The answer of a run takes into account that its confirmation may have failed, which a policy need not know.
        return replace(
            event, belief=replace(belief, estimate=event.estimate) if isinstance(event, Finished) else belief
        )

    def _belief(self) -> AngleBelief:
        estimate = self._policy.estimate()
        if isinstance(self._policy, Posterior | SweepPosterior):
            public = self._policy.belief
            if public is None:
                return AngleBelief(estimate=estimate)
            angles_deg, density = _thinned(public.angles_deg, public.probability / np.diff(public.angles_deg[:2]))
            choice = public.choice
            return AngleBelief(
                estimate=estimate,
                angles_deg=_rounded(angles_deg, 3),
                density_per_deg=_rounded(density, 5),
                choice_deg=() if choice is None else _rounded(choice.angles_deg, 3),
                choice_sigma_deg=() if choice is None else _rounded(choice.sigma_deg, 4),
            )
        method = self._policy.inner if isinstance(self._policy, CheckedPolicy) else self._policy
        bracket = method.bracket if isinstance(method, BracketSearch) else None
        return AngleBelief(
            estimate=estimate,
            claims=not self._plan.as_published,
            bracket_deg=None if bracket is None else (bracket.low_deg, bracket.high_deg),
            weights=self._weights() if self._plan.method == "weighted-average" else (),
        )

    def _weights(self) -> tuple[float, ...]:
        """Share of the largest sample; 0 below the threshold of the method."""
        largest = max(self._intensities)
        shares = [value / largest if largest > 0 else 1.0 for value in self._intensities]
        return tuple(share if share >= THRESHOLD else 0.0 for share in shares)


def _rounded(values: Float64[np.ndarray, " values"], digits: int) -> tuple[float, ...]:
    """To a digit that no picture shows; it keeps an event within a few kilobytes."""
    return tuple(np.round(values, digits).tolist())


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
