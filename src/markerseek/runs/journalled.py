"""Runs that are kept in a journal: each event is committed before it is handed out."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager

import msgspec

from markerseek.core import Clock, Event, Failed, Measured, Policy, Refused, Started
from markerseek.records.journal import Configuration, Journal
from markerseek.rigs.rig import Rig
from markerseek.scan import AnyScanner, RunLimits, run

_RUN_LIMITS = RunLimits()


def configuration_of(
    rig: Rig,
    *,
    method: str,
    acquisitions: int | None,
    as_published: bool,
    start_deg: float,
    dark_frames: int,
    stay: bool,
    seed: int | None,
) -> Configuration:
    """What a journal says of a search on a rig before it begins.

    Parameters
    ----------
    rig
        The rig.
    method, acquisitions, as_published, start_deg
        Arguments of `markerseek.search.build`; its limits are the rig's search range.
    dark_frames, stay
        Arguments of `markerseek.scan.run`.
    seed
        Seed of a simulation.
    """
    return Configuration(
        method=method,
        acquisitions=acquisitions,
        as_published=as_published,
        search=rig.limits.search,
        start_deg=start_deg,
        dark_frames=dark_frames,
        stay=stay,
        closing_dark=rig.closing_dark,
        rig=rig.kind,
        recipe=msgspec.Raw(msgspec.json.encode(rig.recipe)),
        imaging=msgspec.Raw(msgspec.json.encode(None if rig.imaging is None else rig.imaging.preset)),
        fingerprint=rig.configuration,
        description=rig.description,
        face_radius_m=rig.face_radius_m,
        truth_deg=rig.truth_deg,
        reference_deg=rig.reference_deg,
        seed=seed,
    )


def run_configured(
    policy: Policy, scanner: AnyScanner, configuration: Configuration, *, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """`markerseek.scan.run` with the dark frames and the end that a configuration asks for.

    Parameters
    ----------
    policy, scanner
        What searches, on what.
    configuration
        Says how many dark frames to take, and whether to stay.
    limits
        As in `run`.
    """
    return run(
        policy,
        scanner,
        dark_frames=configuration.dark_frames,
        stay=configuration.stay,
        closing_dark=configuration.closing_dark,
        limits=limits,
    )


def search_events(
    policy: Policy, rig: Rig, begun_with: Configuration, journal: Journal | None
) -> Generator[Event, None, None]:
    """The events of a new search, kept where there is a journal.

    Parameters
    ----------
    policy, rig
        What searches, on what.
    begun_with
        Says how many dark frames to take, and whether to stay.
    journal
        A new one, or None.
    """
    if journal is not None:
        return journalled(policy, rig, journal)
    return run_configured(policy, rig.scanner, begun_with)


def journalled(
    policy: Policy, rig: Rig, journal: Journal, *, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """`run_configured`, each event on the disk before it is handed out, and so before the policy receives it.

    Parameters
    ----------
    policy, rig
        What searches, on what.
    journal
        A new one; its configuration says how many dark frames to take, and whether to stay.
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
    events = run_configured(policy, rig.scanner, journal.configuration, limits=limits)
    with closed_and_kept(events, clock, journal):
        for event in events:
            keep(event, clock, rig, journal)
            yield event


@contextmanager
def closed_and_kept(events: Generator[Event, None, None], clock: Clock, journal: Journal) -> Iterator[None]:
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


def keep(event: Event, clock: Clock, rig: Rig, journal: Journal) -> None:
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
