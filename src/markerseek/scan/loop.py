"""`run`: the measuring loop, which drives a policy over a rig and reports each step.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterable
from contextlib import closing
from dataclasses import dataclass, field

from msgspec import structs

from markerseek.core import (
    MAX_ACQUISITIONS,
    AcquisitionError,
    AnyPolicy,
    Asked,
    ConfigError,
    ConfirmablePolicy,
    Event,
    Failed,
    Finished,
    FollowedTissue,
    Found,
    Measured,
    RecordingPolicy,
    Refused,
    Role,
    RunPlan,
    Sample,
    SaturationError,
    SearchError,
    Started,
    Sweep,
    SweepingPolicy,
    Swept,
    estimate_of,
)
from markerseek.guard import Limits, State
from markerseek.scan.confirmation import apply_confirmation
from markerseek.scan.scanner import Scanner


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """Limits of a run, beyond which it is ended with an error."""

    acquisitions: int = MAX_ACQUISITIONS
    """Most acquisitions that a policy may ask for."""
    duration_s: float = 3600.0 * 3
    """Longest time on the rig's clock."""
    attempts: int = 3
    """How often one acquisition is tried when its frames are refused."""

    def __post_init__(self) -> None:
        if self.attempts < 1:
            raise ConfigError(f"run limits: attempts is {self.attempts}, at least 1 is needed")


@dataclass(slots=True, kw_only=True)
class Tally:
    """What the events of a run add up to; a run that was interrupted goes on from that of its record."""

    elapsed_s: float = 0.0
    """How long the run had taken before it was interrupted."""
    counts: Counter[Role] = field(default_factory=Counter)
    """Acquisitions of each role."""
    steps: int = 0
    """Acquisitions at rest that the policy asked for, and sweeps."""
    sweeps: int = 0
    travel_deg: float = 0.0
    place_deg: float | None = None
    """Where the probe is as far as the events say; None before the first event."""
    lit: list[Sample] = field(default_factory=list)
    """Samples with light, without their frames: 128 channels of some thousand samples each."""
    confirmation: Sample | None = None
    """The last confirmation."""
    confirmed: bool = False
    """Whether nothing was measured with light after the confirmation."""
    sweep_from_deg: float | None = None
    """Where a sweep began that is not finished."""

    @classmethod
    def of(cls, events: Iterable[object], *, elapsed_s: float = 0.0) -> Tally:
        """Return the tally of recorded events; ``elapsed_s``: how long the run has taken."""
        tally = cls(elapsed_s=elapsed_s)
        for event in events:
            tally.add(event)
        return tally

    def add(self, event: object) -> None:
        """Add an event."""
        match event:
            case Started(start_deg=start_deg):
                self.place_deg = start_deg
            case Asked(sweep=sweep):
                self.sweep_from_deg = None if sweep is None else sweep.from_deg
                if sweep is not None:
                    self.sweeps += 1
                    self.steps += 1
                self.turn(self.sweep_from_deg)
            case Measured(role=role, sample=sample):
                self.counts[role] += 1
                if not sample.dark:
                    if role == "search" and sample.sweep is None:
                        self.steps += 1
                    self.confirmed = role == "confirmation"
                    self.confirmation = sample if self.confirmed else self.confirmation
                    self.lit.append(structs.replace(sample, frame=None))
                    self.turn(sample.angle_deg)
            case Swept(angle_deg=angle_deg):
                self.sweep_from_deg = None
                self.confirmed = False
                self.turn(angle_deg)

    def turn(self, angle_deg: float | None) -> None:
        """Count the way to an angle, if it is known."""
        if angle_deg is not None and self.place_deg is not None:
            self.travel_deg += abs(angle_deg - self.place_deg)
            self.place_deg = angle_deg


_RUN_LIMITS = RunLimits()
_RUN_PLAN = RunPlan()


def run(
    policy: AnyPolicy,
    scanner: Scanner,
    plan: RunPlan = _RUN_PLAN,
    *,
    limits: RunLimits = _RUN_LIMITS,
    earlier: Tally | None = None,
    tissue: FollowedTissue | None = None,
) -> Generator[Event, None, None]:
    """Let a policy search on a rig, and report each step.

    A search that found a marker ends with a move to it and one acquisition there. A `ConfirmablePolicy` weighs that
    acquisition, and the search goes on if it then asks for another angle. Where the last one does not confirm the angle
    (`markerseek.scan.confirmation`), the answer becomes `Unsure`; only the paper's form of a method, which has no noise
    floor, keeps its answer. Each `Measured` is yielded before the policy receives it.

    Parameters
    ----------
    policy
        Chooses the angles.
    scanner
        The rig.
    plan
        How the run begins and ends; the plan of a whole search is one as well.
    limits
        Limits of the run.
    earlier
        State of an interrupted run, from which the run goes on; the policy must have got all of its samples.
    tissue
        The tissue, where it is followed: samples state its displacement.

    Yields
    ------
    Event
        Started; Asked, Turning, Refused, Measured and Swept; then Finished, or Failed followed by its error.

    Raises
    ------
    Exception
        Whatever ended the run, a `MarkerseekError` unless a driver has a bug; the probe stays where it stopped.
    """
    tally = earlier or Tally()
    try:
        with closing(_search(policy, scanner, plan, limits, tally, tissue)) as events:
            for event in events:
                tally.add(event)
                yield event
    except Exception as error:
        yield Failed(error=error)
        raise
    finally:
        # Also when the generator is closed or an exception passes through the caller of `next`.
        scanner.stop()


def _search(
    policy: AnyPolicy,
    scanner: Scanner,
    plan: RunPlan,
    limits: RunLimits,
    tally: Tally,
    tissue: FollowedTissue | None,
) -> Generator[Event, None, None]:
    """Yield the events of a run up to its answer; the caller adds each to the tally."""
    began_s = scanner.clock.now_s() - tally.elapsed_s
    place_deg = scanner.angle_deg
    if tally.place_deg is None:
        yield Started(start_deg=place_deg, limits=scanner.limits.search)
    tally.place_deg = place_deg
    while tally.counts["dark"] < plan.dark_frames:
        yield from _step(policy, scanner, tally, "dark", place_deg, limits.attempts)
    # A sweep that was interrupted is made again from its beginning.
    tally.turn(tally.sweep_from_deg)
    searching = True
    while searching:
        # The caller owns the loop (ask and tell): all that is measured is yielded, journalled and limited here.
        while (asked := policy.ask()) is not None:
            _require_budget(tally.steps, scanner.clock.now_s() - began_s, limits)
            yield from _step(policy, scanner, tally, "search", asked, limits.attempts, tissue)
            _require_order(scanner, policy)
        estimate = estimate_of(policy)
        known_s = scanner.clock.now_s() - began_s
        searching = isinstance(estimate, Found) and not plan.stay
        if searching:
            if not tally.confirmed:
                yield from _step(policy, scanner, tally, "confirmation", estimate.mean_deg, limits.attempts, tissue)
                estimate = estimate_of(policy)
            assert tally.confirmation is not None  # noqa: S101 - it was taken now or before
            searching = isinstance(policy, ConfirmablePolicy) and policy.ask() is not None
            estimate = apply_confirmation(estimate, tally.confirmation, tally.lit[:-1])
    if plan.closing_dark and tally.lit:
        # One attempt: if frames are late by one, a second would show the dark data of the first and hide it.
        yield from _step(policy, scanner, tally, "dark", tally.place_deg, 1)
    yield Finished(
        estimate=estimate,
        confirmation=tally.confirmation,
        acquisitions=tally.counts["search"],
        travel_deg=tally.travel_deg,
        elapsed_s=scanner.clock.now_s() - began_s,
        known_s=known_s if isinstance(estimate, Found) else None,
        searched=policy.searched if isinstance(policy, RecordingPolicy) else None,
        near=getattr(policy, "near_evidence", None),
    )


def _step(
    policy: AnyPolicy,
    scanner: Scanner,
    tally: Tally,
    role: Role,
    asked: float | Sweep,
    attempts: int,
    tissue: FollowedTissue | None = None,
) -> Generator[Event, None, None]:
    """Yield one step, at rest or in motion, and again while it is refused."""
    step = asked if role == "dark" else _planned_step(asked, policy, scanner.limits, tally)
    angle_deg = step.to_deg if isinstance(step, Sweep) else step
    before = tally.counts[role]
    for attempt in range(1, attempts + 1):
        if attempt == 1 or isinstance(step, Sweep):
            sweep = step if isinstance(step, Sweep) else None
            yield Asked(role=role, index=before + 1, angle_deg=angle_deg, sweep=sweep)
        try:
            # A sweep goes on while the policy asks for it.
            outcomes = scanner.take(
                None if role == "dark" else step,
                number=tally.sweeps,
                goes_on=lambda: policy.ask() == asked,
                tissue=tissue,
            )
            yield from _tell(policy, outcomes, tally, role)
            break
        except SaturationError:
            # Pulses are averaged: the same acquisition would be saturated again.
            raise
        except AcquisitionError as refusal:
            if scanner.guard.state is State.FAULT:
                raise
            # A policy cannot forget: once it has samples of a sweep, the whole sweep cannot be refused any more.
            if tally.counts[role] > before:
                scanner.guard.fail(str(refusal))
                raise
            # A receiver that fails every time needs a person: FAULT is left by a reset only.
            if attempt == attempts:
                error = AcquisitionError(f"{refusal} (refused {attempts} times at {angle_deg:.2f} deg)")
                scanner.guard.fail(str(error))
                raise error from refusal
            yield Refused(angle_deg=angle_deg, reason=str(refusal), frame=scanner.refused_frame)


def _tell(
    policy: AnyPolicy, outcomes: Generator[Sample | Event, None, None], tally: Tally, role: Role
) -> Generator[Event, None, None]:
    """Yield the events of a step that is taken; the policy learns of each once it was yielded."""
    with closing(outcomes):
        for outcome in outcomes:
            if isinstance(outcome, Sample):
                # The dark frame at the end is for the record alone.
                tells = not outcome.dark or not tally.lit
                yield Measured(role=role, index=tally.counts[role] + 1, sample=outcome)
                if role == "confirmation" and isinstance(policy, ConfirmablePolicy):
                    policy.confirm(outcome)
                elif role != "confirmation" and tells:
                    policy.tell(outcome)
            else:
                yield outcome
                if isinstance(outcome, Swept) and isinstance(policy, SweepingPolicy):
                    policy.end_sweep()


def _planned_step(asked: float | Sweep, policy: AnyPolicy, limits: Limits, tally: Tally) -> float | Sweep:
    """Return the step that the policy asked for; refuse one that would leave the search range before anything moves."""
    # Refused before it is yielded as `Asked`: the journal cannot record an angle that is no number.
    if not isinstance(asked, Sweep):
        limits.require_search(asked)
        return asked
    if not isinstance(policy, SweepingPolicy):
        raise SearchError(f"the policy {type(policy).__name__} asks for a sweep and has no end_sweep")
    for angle_deg in (asked.to_deg, asked.end_deg, asked.wait_deg):
        if angle_deg is not None:
            limits.require_search(angle_deg)
    begin_deg = tally.place_deg if asked.from_deg is None else asked.from_deg
    assert begin_deg is not None  # noqa: S101 - the run has started
    # Always stated: a run that is resumed goes on from another angle.
    return structs.replace(asked, from_deg=limits.search.nearest(begin_deg))


def _require_order(scanner: Scanner, policy: AnyPolicy) -> None:
    """Put the rig in FAULT if the policy has seen frames of a sweep in another order than their pulses."""
    disorder = getattr(policy, "disorder", None)
    if disorder is not None:
        scanner.guard.fail(disorder)
        raise AcquisitionError(disorder)


def _require_budget(count: int, elapsed_s: float, limits: RunLimits) -> None:
    if count >= limits.acquisitions:
        raise SearchError(f"the policy asked for more than {limits.acquisitions} acquisitions; its search does not end")
    if not elapsed_s <= limits.duration_s:
        raise SearchError(f"the search took {elapsed_s:.0f} s, more than the {limits.duration_s:.0f} s allowed")
