"""Makes policy and imaging chain of a run from the configuration in its record, and its answer again."""

from __future__ import annotations

from functools import lru_cache

import msgspec
from msgspec.structs import replace

from markerseek.core import AnyPolicy, Estimate, Measured, Reader, ReadingFrame, RecordError
from markerseek.files import recorded_settings
from markerseek.records.journal import Configuration, JournalEntry, RecordedRun, RunView, since_started
from markerseek.runs.journalled import is_scan
from markerseek.runs.resume import tell_recorded
from markerseek.scan import apply_confirmation
from markerseek.search import build_sweeping
from markerseek.signals import ImageReader, IntensityReader, ProbePreset


def rebuild_reader(configuration: Configuration) -> Reader:
    """Return the reader of a journal's rig, without its devices or recording."""
    return _reader(bytes(configuration.imaging))


def rebuild_image_reader(configuration: Configuration) -> ImageReader | None:
    """Return the reader of a journal's rig where it makes photoacoustic images; None if it makes none."""
    reader = rebuild_reader(configuration)
    return reader if isinstance(reader, ImageReader) else None


@lru_cache(maxsize=2)
def _reader(imaging: bytes) -> ImageReader | IntensityReader:
    """Return the imaging chain; cached, because its tables take a quarter of a second."""
    try:
        preset = recorded_settings(imaging, ProbePreset | None)
    except (msgspec.MsgspecError, RecursionError) as problem:
        raise RecordError(f"the journal's imaging chain cannot be read: {problem}") from problem
    return IntensityReader() if preset is None else ImageReader(preset)


def rebuild_policy(configuration: Configuration) -> AnyPolicy:
    """Return the policy of a journal in its state before the run."""
    if is_scan(configuration):
        raise RecordError(
            "the journal is of a scan, not of a search; go on with it: `scan_bank(BANK)`, or make a "
            "bank of it: `journal_bank(JOURNAL, BANK)`"
        )
    return build_sweeping(configuration.plan, limits=configuration.facts.search)


def answer_again(recorded: RecordedRun, *, read_frames: bool) -> Estimate:
    """Return the answer of a run, computed again from its recorded samples.

    ``read_frames``: whether samples whose frame was kept are read from it again.
    """
    policy = rebuild_policy(recorded.configuration)
    entries = since_started(recorded.entries)
    if read_frames:
        reader = rebuild_reader(recorded.configuration)
        entries = tuple(_read_again(entry, reader) for entry in entries)
    tell_recorded(policy, entries)
    estimate = policy.estimate()
    view = RunView.of(recorded.configuration)
    for entry in entries:
        view = view.add_entry(entry)
    return estimate if view.confirmation is None else apply_confirmation(estimate, view.confirmation, view.samples)


def _read_again(entry: JournalEntry, reader: Reader) -> JournalEntry:
    event = entry.event
    if not isinstance(event, Measured) or (frame := event.sample.frame) is None:
        return entry
    reading = (IntensityReader() if isinstance(frame, ReadingFrame) else reader).read(frame)
    return replace(entry, event=replace(event, sample=replace(event.sample, reading=reading)))
