"""Runs a search with a journal: each event is committed before the policy receives it."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import msgspec

from markerseek.core import AnyPolicy, Clock, Event, Failed, Measured, Refused, SearchPlan, Started, Swept
from markerseek.records.journal import Configuration, Journal
from markerseek.rigs import ReaderRecipe, Rig, SpareRecipe, TipRecipe
from markerseek.runs.beliefs import Beliefs
from markerseek.scan import RunLimits, run
from markerseek.signals import SpareReader

_RUN_LIMITS = RunLimits()


def configuration_of(rig: Rig, plan: SearchPlan) -> Configuration:
    """Configuration of a new search for its journal."""
    return Configuration(
        plan=plan,
        facts=rig.facts,
        recipe=msgspec.Raw(msgspec.json.encode(rig.recipe)),
        imaging=msgspec.Raw(msgspec.json.encode(_reader_recipe(rig))),
    )


def _reader_recipe(rig: Rig) -> ReaderRecipe:
    if rig.tip is not None:
        return TipRecipe(settings=rig.tip)
    if isinstance(rig.imaging, SpareReader):
        return SpareRecipe(preset=rig.imaging.preset, receive_focus_m=rig.imaging.receive_focus_m)
    return None if rig.imaging is None else rig.imaging.preset


def journalled(
    policy: AnyPolicy, rig: Rig, journal: Journal, *, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """`run` with each event committed to a journal before it is yielded, and so before the policy receives it.

    ``journal``: a new journal with the plan of the search. Yields as `run`. Raises `RecordError` if an event cannot be
    written; the rig is stopped.
    """
    clock = rig.scanner.clock
    plan = journal.configuration.plan
    events = run(policy, rig.scanner, plan, limits=limits)
    beliefs = Beliefs(policy, plan)
    with closing_run(events, clock, journal):
        for event in map(beliefs.added, events):
            # Before the yield: a policy must never act on a measurement that a crash could lose.
            commit_event(event, clock, rig, journal)
            yield event


@contextmanager
def closing_run(events: Generator[Event, None, None], clock: Clock, journal: Journal) -> Iterator[None]:
    """Close a run at the end, which stops the rig; a failure to stop it is recorded in the journal.

    It is not recorded if the run is over, or ended with another fault.
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
    """Commit an event, with the state of a simulated world where it has changed; `RecordError` if that fails."""
    # `Asked` and `Finished` change nothing in a simulated world: no checkpoint is needed.
    changed = rig.world is not None and isinstance(event, Started | Measured | Swept | Refused | Failed)
    checkpoint = rig.world.checkpoint() if rig.world is not None and changed else None
    journal.commit(event, clock_s=clock.now_s(), checkpoint=checkpoint)
