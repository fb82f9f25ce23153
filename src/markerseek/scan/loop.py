"""`run`: the measuring loop, which drives a policy over a rig and reports each step.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol

from markerseek.core import (
    MAX_ACQUISITIONS,
    AcquisitionError,
    AnyPolicy,
    Asked,
    Clock,
    ConfigError,
    ConfirmablePolicy,
    Event,
    Failed,
    Finished,
    Found,
    Frame,
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
    Turning,
)
from markerseek.guard import Guard, Limits, State
from markerseek.scan.confirmation import apply_confirmation


class AnyScanner(Protocol):
    """What `run` uses of a scanner: a `Scanner`, or one that replays a journal."""

    @property
    def clock(self) -> Clock:
        """Time on the rig."""

    @property
    def guard(self) -> Guard:
        """The rig's guard."""

    @property
    def limits(self) -> Limits:
        """Angles that may be searched, and at which the probe may be."""

    @property
    def angle_deg(self) -> float:
        """Angle of the probe now, in degrees."""

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused."""

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Where the probe is while a person turns it to an angle, before `measure` there."""

    def measure(self, angle_deg: float) -> Sample:
        """One acquisition at an angle, in degrees."""

    def measure_dark(self) -> Sample:
        """One acquisition at the present angle, with the laser off."""

    def sweep(
        self, sweep: Sweep, *, number: int, goes_on: Callable[[], bool]
    ) -> Generator[Sample | Refused | Swept, None, None]:
        """The samples of one sweep while it goes on, or why the frame of a pulse was refused; then its end."""

    def stop(self) -> None:
        """Disarm the guard and the laser, then stop the stage; allowed twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """Limits of a run, beyond which it is ended with an error."""

    acquisitions: int = MAX_ACQUISITIONS
    """Most acquisitions that a policy may ask for."""
    duration_s: float = 3600.0 * 3
    """Longest time on the rig's clock."""
    attempts: int = 3
    """How often one acquisition is tried when its frames are refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Earlier:
    """How far a run had come before it was interrupted; its policy has been told all of it."""

    dark: int = 0
    acquisitions: int = 0
    steps: int = 0
    """Acquisitions at rest and sweeps."""
    sweeps: int = 0
    confirmations: int = 0
    travel_deg: float = 0.0
    elapsed_s: float = 0.0
    lit: tuple[Sample, ...] = ()
    """Samples with light, without their frames."""
    confirmation: Sample | None = None
    """The last of them, if it is a confirmation."""
    sweep_from_deg: float | None = None
    """Where a sweep began that was not finished."""

    @classmethod
    def of(cls, events: Sequence[object], *, elapsed_s: float) -> Earlier | None:
        """What the events of a run add up to; None before its first."""
        starts = [event.start_deg for event in events if isinstance(event, Started)]
        if not starts:
            return None
        measured = [event for event in events if isinstance(event, Measured)]
        lit = [replace(event.sample, frame=None) for event in measured if not event.sample.dark]
        confirmed = bool(measured) and measured[-1].role == "confirmation"
        sweeps = sum(isinstance(event, Asked) and event.sweep is not None for event in events)
        last = next((event for event in reversed(events) if isinstance(event, Asked | Swept)), None)
        return cls(
            dark=sum(event.role == "dark" for event in measured),
            acquisitions=sum(event.role == "search" for event in measured),
            steps=sweeps + sum(event.role == "search" and event.sample.sweep is None for event in measured),
            sweeps=sweeps,
            confirmations=sum(event.role == "confirmation" for event in measured),
            travel_deg=sum(abs(to - at) for at, to in pairwise([*starts[-1:], *(each.angle_deg for each in lit)])),
            elapsed_s=elapsed_s,
            lit=tuple(lit),
            confirmation=lit[-1] if confirmed else None,
            sweep_from_deg=last.sweep.from_deg if isinstance(last, Asked) and last.sweep is not None else None,
        )

    @property
    def intensities(self) -> list[float]:
        """Intensities of the samples with light."""
        return [sample.reading.intensity for sample in self.lit]


_RUN_LIMITS, _RUN_PLAN, _NOTHING = RunLimits(), RunPlan(), Earlier()


def run(
    policy: AnyPolicy,
    scanner: AnyScanner,
    plan: RunPlan = _RUN_PLAN,
    *,
    limits: RunLimits = _RUN_LIMITS,
    earlier: Earlier | None = None,
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
        How far it had come before it was interrupted; it then goes on instead of beginning.

    Yields
    ------
    Event
        Started; Asked, Turning, Refused, Measured and Swept; then Finished, or Failed followed by its error.

    Raises
    ------
    Exception
        Whatever ended the run, a `MarkerseekError` unless a driver has a bug; the probe stays where it stopped.
    """
    before = earlier or _NOTHING
    began_s = scanner.clock.now_s() - before.elapsed_s
    travel_deg = before.travel_deg
    lit = list(before.lit)
    # A confirmation that was kept is not taken again.
    kept = before.confirmation
    try:
        place_deg = scanner.angle_deg
        if earlier is None:
            yield Started(start_deg=place_deg, limits=scanner.limits.search)
        for index in range(before.dark + 1, plan.dark_frames + 1):
            dark = yield from _dark(scanner, index, place_deg, limits.attempts)
            policy.tell(dark)
        # Steps: a sweep of many acquisitions is one of them.
        steps, sweeps = before.steps, before.sweeps
        acquisitions, confirmations = before.acquisitions, before.confirmations
        confirmation = kept
        begin_deg = place_deg if before.sweep_from_deg is None else before.sweep_from_deg
        travel_deg, place_deg = travel_deg + abs(place_deg - begin_deg), begin_deg
        searching = True
        while searching:
            # The caller owns the loop (ask and tell): all that is measured is yielded, journalled and limited here.
            while (asked := policy.ask()) is not None:
                _require_budget(steps, scanner.clock.now_s() - began_s, limits)
                steps, kept = steps + 1, None
                if isinstance(asked, Sweep):
                    done = _SweepsDone(sweeps=sweeps, acquisitions=acquisitions, way_deg=[place_deg])
                    yield from _swept(scanner, policy, asked, done, attempts=limits.attempts)
                    _require_order(scanner, policy)
                    travel_deg += sum(abs(to - at) for at, to in pairwise(done.way_deg))
                    sweeps, acquisitions, place_deg = done.sweeps, done.acquisitions, done.way_deg[-1]
                    lit += done.samples
                    continue
                acquisitions += 1
                sample = yield from _measured(scanner, "search", acquisitions, asked, limits.attempts)
                # Without its frame: 128 channels of some thousand samples each, over hundreds of acquisitions.
                lit.append(replace(sample, frame=None))
                travel_deg += abs(sample.angle_deg - place_deg)
                place_deg = sample.angle_deg
                policy.tell(sample)
            estimate, known_s = policy.estimate(), scanner.clock.now_s() - began_s
            searching = isinstance(estimate, Found) and not plan.stay
            if searching:
                if kept is None:
                    confirmations += 1
                    confirmation = yield from _confirmed(
                        scanner, policy, confirmations, estimate.mean_deg, limits.attempts
                    )
                    travel_deg += abs(confirmation.angle_deg - place_deg)
                    place_deg = confirmation.angle_deg
                    lit.append(replace(confirmation, frame=None))
                    estimate = policy.estimate()
                assert confirmation is not None  # noqa: S101 - it was taken now or kept
                searching = isinstance(policy, ConfirmablePolicy) and policy.ask() is not None
                estimate = apply_confirmation(estimate, confirmation, lit[:-1])
        if plan.closing_dark and lit:
            # One attempt: if frames are late by one, a second would show the dark data of the first and hide it.
            yield from _dark(scanner, plan.dark_frames + 1, place_deg, 1)
        yield Finished(
            estimate=estimate,
            confirmation=confirmation,
            acquisitions=acquisitions,
            travel_deg=travel_deg,
            elapsed_s=scanner.clock.now_s() - began_s,
            known_s=known_s if isinstance(estimate, Found) else None,
            searched=policy.searched if isinstance(policy, RecordingPolicy) else None,
            near=getattr(policy, "near_evidence", None),
        )
    except Exception as error:
        yield Failed(error=error)
        raise
    finally:
        # Also when the generator is closed or an exception passes through the caller of `next`.
        scanner.stop()


def _dark(scanner: AnyScanner, index: int, angle_deg: float, attempts: int) -> Generator[Event, None, Sample]:
    """A dark frame at the present angle."""
    yield Asked(role="dark", index=index, angle_deg=angle_deg)
    sample = yield from _admitted(scanner, scanner.measure_dark, angle_deg, attempts)
    yield Measured(role="dark", index=index, sample=sample)
    return sample


def _measured(
    scanner: AnyScanner, role: Role, index: int, angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """An acquisition at an angle of the search range."""
    # Refused before it is yielded as `Asked`: the journal cannot record an angle that is no number.
    scanner.limits.require_search(angle_deg)
    yield Asked(role=role, index=index, angle_deg=angle_deg)
    yield from scanner.guide(angle_deg)
    sample = yield from _admitted(scanner, lambda: scanner.measure(angle_deg), angle_deg, attempts)
    yield Measured(role=role, index=index, sample=sample)
    return sample


def _confirmed(
    scanner: AnyScanner, policy: AnyPolicy, index: int, angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """An acquisition at the angle found, which a `ConfirmablePolicy` weighs."""
    sample = yield from _measured(scanner, "confirmation", index, angle_deg, attempts)
    if isinstance(policy, ConfirmablePolicy):
        policy.confirm(sample)
    return sample


@dataclass(slots=True, kw_only=True)
class _SweepsDone:
    """How far a run has come with its sweeps."""

    sweeps: int
    acquisitions: int
    way_deg: list[float]
    """Where the probe was before and after, and at each pulse."""
    samples: list[Sample] = field(default_factory=list)
    """Without their frames."""
    wanted: bool = True
    """Whether the policy still asks for the sweep."""


def _swept(
    scanner: AnyScanner, policy: AnyPolicy, asked: Sweep, done: _SweepsDone, *, attempts: int
) -> Generator[Event, None, None]:
    """A sweep: the policy is told each sample as it comes, may end it early, and is told when it is over.

    One that was broken off by a kill, or refused whole, is made again from its beginning while the policy wants it.
    """
    if not isinstance(policy, SweepingPolicy):
        raise SearchError(f"the policy {type(policy).__name__} asks for a sweep and has no end_sweep")
    begin_deg = done.way_deg[-1] if asked.from_deg is None else asked.from_deg
    # Always stated: a run that is resumed goes on from another angle.
    from_deg = scanner.limits.search.nearest(begin_deg)
    sweep = replace(asked, from_deg=from_deg)
    _require_inside(sweep, scanner.limits)
    for attempt in range(1, attempts + 1):
        done.sweeps += 1
        done.way_deg.append(from_deg)
        yield Asked(role="search", index=done.acquisitions + 1, angle_deg=sweep.to_deg, sweep=sweep)
        try:
            with closing(scanner.sweep(sweep, number=done.sweeps, goes_on=lambda: done.wanted)) as outcomes:
                for outcome in outcomes:
                    if not isinstance(outcome, Sample):
                        yield outcome
                        if isinstance(outcome, Swept):
                            done.way_deg.append(outcome.angle_deg)
                            policy.end_sweep()
                            return
                        continue
                    done.acquisitions += 1
                    yield Measured(role="search", index=done.acquisitions, sample=outcome)
                    done.samples.append(replace(outcome, frame=None))
                    done.way_deg.append(outcome.angle_deg)
                    policy.tell(outcome)
                    # Asked after each sample until it wants no more: a run that is repeated must ask as often.
                    done.wanted = done.wanted and policy.ask() == asked
        except SaturationError:
            raise
        except AcquisitionError as refusal:
            # A policy cannot forget: if some samples of a sweep were told, it cannot be refused whole any more.
            if done.samples or scanner.guard.state is State.FAULT or attempt == attempts:
                scanner.guard.fail(str(refusal))
                raise
            yield Refused(angle_deg=sweep.to_deg, reason=str(refusal))
        if not done.wanted:
            return


def _require_order(scanner: AnyScanner, policy: AnyPolicy) -> None:
    """A fault where a policy has seen that the frames of its sweeps are not of the pulses in their order."""
    disorder = getattr(policy, "disorder", None)
    if disorder is not None:
        scanner.guard.fail(disorder)
        raise AcquisitionError(disorder)


def _require_inside(sweep: Sweep, limits: Limits) -> None:
    """Refuse a sweep that would leave the range, before anything moves."""
    limits.require_search(sweep.to_deg)
    limits.require_search(sweep.end_deg)
    if sweep.wait_deg is not None:
        limits.require_search(sweep.wait_deg)


def _admitted(
    scanner: AnyScanner, measure: Callable[[], Sample], angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """Measure again while frames are refused, at most `attempts` times."""
    for attempt in range(1, attempts + 1):
        try:
            return measure()
        except SaturationError:
            # Pulses are averaged: the same acquisition would be saturated again.
            raise
        except AcquisitionError as refusal:
            if scanner.guard.state is State.FAULT:
                raise
            # A receiver that fails every time needs a person: FAULT is left by a reset only.
            if attempt == attempts:
                error = AcquisitionError(f"{refusal} (refused {attempts} times at {angle_deg:.2f} deg)")
                scanner.guard.fail(str(error))
                raise error from refusal
            yield Refused(angle_deg=angle_deg, reason=str(refusal), frame=scanner.refused_frame)
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def _require_budget(count: int, elapsed_s: float, limits: RunLimits) -> None:
    if count >= limits.acquisitions:
        raise SearchError(f"the policy asked for more than {limits.acquisitions} acquisitions; its search does not end")
    if not elapsed_s <= limits.duration_s:
        raise SearchError(f"the search took {elapsed_s:.0f} s, more than the {limits.duration_s:.0f} s allowed")
