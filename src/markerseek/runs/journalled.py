"""Runs that are kept in a journal: each event is committed before it is handed out."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import msgspec

from markerseek.core import Clock, Event, Failed, Measured, Policy, Refused, SearchPlan, Started
from markerseek.records.journal import Configuration, Journal
from markerseek.rigs import Rig
from markerseek.scan import AnyScanner, RunLimits, run

_RUN_LIMITS = RunLimits()


def configuration_of(rig: Rig, plan: SearchPlan) -> Configuration:
    """What a journal holds of a search before it begins.

    Parameters
    ----------
    rig, plan
        The rig, and what is asked of the search.
    """
    return Configuration(
        plan=plan,
        facts=rig.facts,
        recipe=msgspec.Raw(msgspec.json.encode(rig.recipe)),
        imaging=msgspec.Raw(msgspec.json.encode(None if rig.imaging is None else rig.imaging.preset)),
    )


def run_plan(
    policy: Policy, scanner: AnyScanner, plan: SearchPlan, *, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """`markerseek.scan.run` with the dark frames and the end that a plan asks for.

    Parameters
    ----------
    policy, scanner
        What searches, on what.
    plan
        Says how many dark frames to take, and how to end.
    limits
        As in `run`.
    """
    return run(
        policy,
        scanner,
        dark_frames=plan.dark_frames,
        stay=plan.stay,
        closing_dark=plan.closing_dark,
        limits=limits,
    )


def journalled(
    policy: Policy, rig: Rig, journal: Journal, *, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """`run_plan`, each event on the disk before it is handed out, and so before the policy receives it.

    Parameters
    ----------
    policy, rig
        What searches, on what.
    journal
        A new one; its plan says how many dark frames to take, and how to end.
    limits
        As in `run`.

    Yields
    ------
    Event
        As `run`.

    Raises
    ------
    RecordError
        If an event cannot be kept; the rig is stopped.
    """
    clock = rig.scanner.clock
    events = run_plan(policy, rig.scanner, journal.configuration.plan, limits=limits)
    with closing_run(events, clock, journal):
        for event in events:
            commit_event(event, clock, rig, journal)
            yield event


@contextmanager
def closing_run(events: Generator[Event, None, None], clock: Clock, journal: Journal) -> Iterator[None]:
    """Close a run at the end, which stops the rig; a rig that cannot be stopped is a fault, which the journal keeps.

    Parameters
    ----------
    events
        The run.
    clock
        Its clock.
    journal
        Where the fault is kept, unless the run is over or ended with another.
    """
    try:
        yield
    finally:
        try:
            events.close()
        except Exception as error:
            journal.fail(error, clock_s=clock.now_s())
            raise


def commit_event(event: Event, clock: Clock, rig: Rig, journal: Journal) -> None:
    """Commit an event, with the state of a simulated world where it has changed.

    Parameters
    ----------
    event
        What happened.
    clock
        The run's clock.
    rig
        Where it happened.
    journal
        Where it is kept.

    Raises
    ------
    RecordError
        If it cannot be written.
    """
    changed = rig.world is not None and isinstance(event, Started | Measured | Refused | Failed)
    checkpoint = rig.world.checkpoint() if rig.world is not None and changed else None
    journal.commit(event, clock_s=clock.now_s(), checkpoint=checkpoint)
