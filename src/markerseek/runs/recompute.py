"""Recomputes a run from the frames in its journal and compares readings, decisions and answer bit for bit."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

from markerseek.core import AnyPolicy, Finished, Measured, Reader, ReadingFrame
from markerseek.guard import Limits
from markerseek.records.journal import Entry, JournalEvent, RecordedRun
from markerseek.runs.beliefs import Beliefs
from markerseek.runs.recorded_scanner import RecordedScanner
from markerseek.runs.resume import RUN_EVENTS
from markerseek.scan import run
from markerseek.signals import IntensityReader


def recompute_differences(recorded: RecordedRun, policy: AnyPolicy, reader: Reader) -> list[str]:
    """Differences, bit for bit, between a run recomputed from its frames and its journal; empty if there are none.

    Each stored frame is read again, the policy, in its state before the run, receives the readings, and its decisions
    and its answer are compared with those of the journal.
    """
    found: list[str] = []
    again = [_read_again(entry, reader, found) for entry in recorded.entries if isinstance(entry.event, RUN_EVENTS)]
    if not again:
        return []
    search = recorded.configuration.facts.search
    # A journal does not hold the limits of travel; nothing moves here.
    scanner = RecordedScanner(again, limits=Limits(search=search, travel=search))
    plan = recorded.configuration.plan
    events = run(policy, scanner, plan)
    beliefs = Beliefs(policy, plan)
    with closing(events):
        # Not strict: the journal of an interrupted run ends before the run does.
        for entry, event in zip(again, map(beliefs.added, events), strict=False):
            if _timeless(event) != _timeless(entry.event):
                found.append(f"entry {entry.number}: {event} where the journal has {entry.event}")
                # Later decisions depend on this one, so that their differences would say nothing new.
                break
    return found


def _timeless(event: JournalEvent) -> JournalEvent:
    """The event without the duration of the run, which cannot be recomputed from frames."""
    return replace(event, elapsed_s=0.0) if isinstance(event, Finished) else event


def _read_again(entry: Entry, reader: Reader, found: list[str]) -> Entry:
    """The entry with its reading recomputed; appends a difference to `found`."""
    event = entry.event
    if not isinstance(event, Measured) or event.sample.frame is None:
        return entry
    frame = event.sample.frame
    reading = (IntensityReader() if isinstance(frame, ReadingFrame) else reader).read(frame)
    if reading != event.sample.reading:
        found.append(f"entry {entry.number}: its frame is read as {reading}, the journal has {event.sample.reading}")
    return replace(entry, event=replace(event, sample=replace(event.sample, reading=reading)))
