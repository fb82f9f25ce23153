"""Runs a search with a journal: each event is committed before the policy receives it."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TypeGuard

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import (
    AngleBelief,
    AnyPolicy,
    Asked,
    Event,
    Finished,
    Float64,
    FollowedTissue,
    Measured,
    SearchPlan,
    estimate_of,
)
from markerseek.records.journal import Configuration, Journal
from markerseek.rigs import Rig
from markerseek.scan import RunLimits, run
from markerseek.search import THRESHOLD, BracketSearch, CheckedPolicy, WholeRecording
from markerseek.search.posterior import Posterior, SweepPosterior

_RUN_LIMITS = RunLimits()

_S_PER_ANGLE = 120.0
"""Limit in seconds for each acquisition of a scan, for stages that are slow and receivers that average long."""


def is_scan(configuration: Configuration) -> bool:
    """Return whether the run is a scan that is to become a bank."""
    return bytes(configuration.bank) != b"null"


def limits_of(configuration: Configuration, *, angles: int | None = None) -> RunLimits:
    """Return the limits of a run, new or repeated.

    A scan may take more acquisitions and time for more angles, a whole recording more acquisitions. With a prior over
    the angle there are twice as many, because it may be given up.

    ``angles``: number of angles of a scan; None: as many as its plan names.
    """
    plan = configuration.plan
    if plan.whole:
        return replace(_RUN_LIMITS, acquisitions=_RUN_LIMITS.acquisitions + len(plan.angles_deg or ()))
    angles = plan.acquisitions if angles is None else angles
    if plan.near is not None:
        # Once it is given up, the whole number of acquisitions is left.
        return replace(_RUN_LIMITS, acquisitions=2 * _RUN_LIMITS.acquisitions)
    if angles is None or not is_scan(configuration):
        return _RUN_LIMITS
    return RunLimits(acquisitions=angles, duration_s=_S_PER_ANGLE * (angles + plan.dark_frames))


def configuration_of(rig: Rig, plan: SearchPlan) -> Configuration:
    """Return the configuration of a new search for its journal."""
    return Configuration(
        plan=plan,
        facts=rig.facts,
        recipe=msgspec.Raw(msgspec.json.encode(rig.recipe)),
        # None stands for intensities.
        imaging=msgspec.Raw(msgspec.json.encode(None if rig.imaging is None else rig.imaging.preset)),
    )


def journalled(
    policy: AnyPolicy,
    rig: Rig,
    journal: Journal,
    *,
    limits: RunLimits = _RUN_LIMITS,
    tissue: FollowedTissue | None = None,
) -> Generator[Event, None, None]:
    """`run` with each event committed to a journal before it is yielded, and so before the policy receives it.

    ``journal``: a new journal with the plan of the search. ``tissue``: as of `run`. Yields as `run`. Raises
    `RecordError` if an event cannot be written; the rig is stopped.
    """
    events = run(policy, rig.scanner, journal.configuration.plan, limits=limits, tissue=tissue)
    yield from committed(events, policy, rig, journal)


def committed(
    events: Generator[Event, None, None],
    policy: AnyPolicy,
    rig: Rig,
    journal: Journal,
    *,
    ahead_s: float = 0.0,
    earlier: Iterable[object] = (),
) -> Generator[Event, None, None]:
    """Yield the events of a run, each committed before it is yielded, and so before the policy receives it.

    ``ahead_s``: seconds by which the clock of the record is ahead of that of the rig, after a restart. ``earlier``:
    events of the run before it, of which the policy has the samples.
    """
    clock = rig.scanner.clock
    intensities = [event.sample.reading.intensity for event in earlier if _is_of_search(event)]
    try:
        for event in with_beliefs(events, policy, journal.configuration.plan, intensities=intensities):
            journal.commit(event, clock_s=clock.now_s() + ahead_s)
            yield event
    finally:
        try:
            # Stops the rig. A failure to stop it is recorded unless the run is over, or ended with another fault.
            events.close()
        except Exception as error:
            journal.fail(error, clock_s=clock.now_s() + ahead_s)
            raise


def _is_of_search(event: object) -> TypeGuard[Measured]:
    """Return whether an event is an acquisition with light that the policy asked for, and no confirmation."""
    return isinstance(event, Measured) and event.role == "search"


ZEROS_DEG = 0.6
"""Width in degrees on both sides of the density that is kept though it is zero there; a pixel of a chart has 0.2."""


def with_beliefs(
    events: Iterable[Event],
    policy: AnyPolicy,
    plan: SearchPlan,
    *,
    of: tuple[type[Event], ...] = (Asked, Finished),
    intensities: Sequence[float] = (),
) -> Iterator[Event]:
    """Return the events of a run, some with the belief of the policy.

    ``of``: which events have one. ``intensities``: those that the run had measured before.
    """
    return map(_Beliefs(policy, plan, of=of, intensities=intensities).add, events)


class _Beliefs:
    """Adds the belief of a policy to events."""

    def __init__(
        self, policy: AnyPolicy, plan: SearchPlan, *, of: tuple[type[Event], ...], intensities: Sequence[float]
    ) -> None:
        self._given = policy
        self._plan = plan
        self._of = of
        self._intensities = list(intensities)

    def add(self, event: Event) -> Event:
        """Return the event, with the belief of the policy if it is to have one."""
        if _is_of_search(event):
            self._intensities.append(event.sample.reading.intensity)
        if not self._intensities or not isinstance(event, Asked | Finished) or not isinstance(event, self._of):
            return event
        belief = self._belief()
        # The answer of a run takes into account that its confirmation may have failed, which a policy need not know.
        return structs.replace(
            event, belief=structs.replace(belief, estimate=event.estimate) if isinstance(event, Finished) else belief
        )

    @property
    def _policy(self) -> AnyPolicy:
        """The policy that searches now."""
        return self._given.present if isinstance(self._given, WholeRecording) else self._given

    def _belief(self) -> AngleBelief:
        estimate = estimate_of(self._policy)
        if isinstance(self._policy, Posterior | SweepPosterior):
            belief = self._policy.belief
            if belief is None:
                return AngleBelief(estimate=estimate)
            angles_deg, density = _thinned(belief.angles_deg, belief.probability / np.diff(belief.angles_deg[:2]))
            return AngleBelief(
                estimate=estimate,
                angles_deg=_rounded(angles_deg, 3),
                density_per_deg=_rounded(density, 5),
                choice_deg=_rounded(belief.choice_deg, 3),
                choice_sigma_deg=_rounded(belief.choice_sigma_deg, 4),
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
        """Return the share of the largest sample; 0 below the threshold of the method."""
        largest = max(self._intensities)
        shares = [value / largest if largest > 0 else 1.0 for value in self._intensities]
        return tuple(share if share >= THRESHOLD else 0.0 for share in shares)


def _rounded(values: Float64[np.ndarray, " values"], digits: int) -> tuple[float, ...]:
    """Round to a digit that no picture shows, which keeps an event within a few kilobytes."""
    return tuple(np.round(values, digits).tolist())


def _thinned(
    angles_deg: Float64[np.ndarray, " angles"], density_per_deg: Float64[np.ndarray, " angles"]
) -> tuple[Float64[np.ndarray, " kept"], Float64[np.ndarray, " kept"]]:
    """Return the density without most of the angles where it is zero: a sharp posterior is zero almost everywhere."""
    seen = density_per_deg > 1e-4 * density_per_deg.max()
    # Zeros for some way beside what is seen: a chart leaves out points that are nearer than a pixel, and a line from
    # the last one that is not zero to the end of the range would look like probability.
    beside = int(np.ceil(ZEROS_DEG / (angles_deg[1] - angles_deg[0])))
    # A range of angles can be shorter than the way of zeros: "same" would return the longer of both.
    kept = np.convolve(seen, np.ones(2 * beside + 1))[beside : beside + seen.size] > 0
    kept[[0, -1]] = True
    return angles_deg[kept], np.where(seen, density_per_deg, 0.0)[kept]
