"""State of a run from its entries; checks of the order of the entries and of their angles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from markerseek.core import Asked, Failed, Finished, Found, Interval, Measured, Refused, Started, Swept, Turning
from markerseek.records.configuration import Configuration
from markerseek.records.journal.events import Checked, Entry, Interrupted, JournalEvent, Resuming

_ARRIVAL_DEG = 0.1
"""Largest distance between the angle asked for and the one reached that the guard accepts of a motor, in degrees."""

_TURN = Interval(low_deg=-360.0, high_deg=360.0)
"""Range of angles at the start and for dark frames: one turn to either side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunState:
    """State of a run."""

    state: Literal["finished", "fault", "open"]
    """Finished with an answer, ended by a fault, or open: it was stopped or it died, and can be resumed."""
    acquisitions: int
    """Acquisitions with light that the policy received, or will receive."""
    fault: str | None
    """None unless it was a fault."""


def run_state(entries: Iterable[Entry]) -> RunState:
    """State of the run of these entries.

    ``entries``: all of them, in order.
    """
    state: Literal["finished", "fault", "open"] = "open"
    acquisitions = 0
    fault: str | None = None
    for entry in entries:
        match entry.event:
            case Measured(role=role):
                acquisitions += role == "search"
            case Finished():
                state = "finished"
            case Failed(error=error):
                state, fault = "fault", str(error)
            case Resuming(fault_reset=True):
                state, fault = "open", None
    return RunState(state=state, acquisitions=acquisitions, fault=fault)


_STEPS: dict[type, tuple[type, ...]] = {
    Started: (Asked, Finished),
    Asked: (Turning, Measured, Refused),
    Turning: (Turning, Measured, Refused),
    Refused: (Measured, Refused),
    Measured: (Asked, Finished),
    Finished: (),
    Swept: (Asked, Finished),
}
"""Events that may follow each event of a run, apart from interruptions in between."""

_SWEEPING_STEPS: dict[type, tuple[type, ...]] = {
    Asked: (Measured, Refused, Swept, Asked),
    Refused: (Measured, Refused, Swept, Asked),
    Measured: (Measured, Refused, Swept, Asked, Finished),
}
"""The same in a sweep. One that a kill broke off, or that was refused, has no end: it is asked for again, or was not
needed any more."""


def order_faults(entries: Sequence[Entry]) -> list[tuple[int, str]]:
    """Entries that are out of order: number and reason of each.

    ``entries``: all of a journal, in order.
    """
    faults: list[tuple[int, str]] = []
    step: type | None = None
    asked: Asked | None = None
    since = 0
    last: JournalEvent | None = None
    for entry in entries:
        event = entry.event
        fault = _fault_of(event, last)
        if type(event) in _STEPS:
            fault = fault or _fault_of_step(event, step, asked, since)
            step = type(event)
            since += isinstance(event, Measured)
        if fault is not None:
            faults.append((entry.number, fault))
        if isinstance(event, Asked):
            asked, since = event, 0
        last = event
    return faults


def _fault_of(event: JournalEvent, last: JournalEvent | None) -> str | None:
    """Reason why an event cannot follow the last one; None if it can."""
    cannot = f"{type(event).__name__} cannot follow {type(last).__name__ if last is not None else 'nothing'}"
    match event, last:
        case (_, Finished()) | (Resuming(fault_reset=False), Failed()) | (Checked(), Resuming(check_deg=None)):
            return cannot
        case Checked(), Resuming() | Checked(difference=None):
            return None
        # A device that does not answer ends a run before its first event; there is nothing to be interrupted then.
        case (Checked(), _) | (Interrupted(), None) | (Interrupted() | Failed(), Interrupted() | Failed()):
            return cannot
        case Interrupted() | Failed() | Resuming(), _:
            return None
        # All others are steps of the run.
        case _, Interrupted() | Failed():
            return cannot
        case _, Checked(difference=str()):
            return "the run went on although the check had found a difference"
        case _, Resuming(check_deg=check_deg) if check_deg is not None:
            return "the run went on without the check that was announced"
    return None


def _fault_of_step(event: JournalEvent, step: type | None, asked: Asked | None, since: int) -> str | None:
    """Reason why a step of the run cannot follow the step before it; None if it can.

    ``since``: acquisitions made since it was asked: of a sweep there are many.
    """
    if isinstance(event, Started):
        return None if step is None else "a run begins once, with its first entry"
    sweeping = asked is not None and asked.sweep is not None
    steps = _STEPS | _SWEEPING_STEPS if sweeping else _STEPS
    if step is None or type(event) not in steps[step] or (isinstance(event, Swept) and not sweeping):
        return f"{type(event).__name__} cannot follow {step.__name__ if step else 'nothing'}"
    if isinstance(event, Measured) and (
        asked is None or (event.role, event.index) != (asked.role, asked.index + since * sweeping)
    ):
        return f"acquisition {event.index} ({event.role}) was not asked for"
    return None


def angle_faults(configuration: Configuration, entries: Iterable[Entry]) -> list[tuple[int, str]]:
    """Entries with an angle outside the limits of their run: number (0: the configuration) and reason of each.

    ``configuration``: what the run was begun with; acquisitions with light lie in its search range. ``entries``: its
    entries, in order.
    """
    search, start_deg = configuration.facts.search, configuration.plan.start_deg
    hand = configuration.plan.by_hand
    # A stage asked for the end of its range can stop slightly outside it.
    beyond_deg = _ARRIVAL_DEG if hand is None else hand.arrival_deg
    reached = Interval(low_deg=search.low_deg - beyond_deg, high_deg=search.high_deg + beyond_deg)
    faults: list[tuple[int, str]] = []
    if start_deg is not None and start_deg not in _TURN:
        faults.append((0, f"the start angle {start_deg:g} deg lies outside {_TURN}"))
    dark = False
    for entry in entries:
        angles: list[tuple[float | None, Interval]] = []
        match entry.event:
            case Started(start_deg=start_deg, limits=limits):
                angles = [(start_deg, _TURN)]
                if limits != search:
                    faults.append((entry.number, f"it searches {limits}, the run was begun with {search}"))
            case Asked(role=role, angle_deg=angle_deg):
                dark = role == "dark"
                angles = [(angle_deg, _TURN if dark else search)]
            case Measured(sample=sample):
                angles = [(sample.angle_deg, _TURN if sample.dark else reached)]
            case Refused(angle_deg=angle_deg) | Swept(angle_deg=angle_deg):
                angles = [(angle_deg, _TURN if dark else reached)]
            case Resuming(check_deg=check_deg, flank_deg=flank_deg):
                angles = [(check_deg, reached), (flank_deg, reached)]
            case Finished(estimate=estimate):
                # Only a claimed marker must lie in the range; other answers may point anywhere.
                angles = [(estimate.mean_deg, search if isinstance(estimate, Found) else _TURN)]
        faults += [
            (entry.number, f"the angle {angle_deg:g} deg lies outside {allowed}")
            for angle_deg, allowed in angles
            if angle_deg is not None and angle_deg not in allowed
        ]
    return faults
