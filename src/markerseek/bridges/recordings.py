"""Recordings as the items that a running search writes, each with its time: journals of runs, and banks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from markerseek.bridges.child import Outcome
from markerseek.core import Measured, Reading, Sample, SearchError, SearchPlan
from markerseek.records.banks import FrameBank, IntensityBank, read_bank
from markerseek.records.exports import series_of
from markerseek.records.journal import Entry, JournalItem, RecordedRun, is_journal, read_journal
from markerseek.rigs import Rig, replayed
from markerseek.runs import RunView, configuration_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """A recording that can be played."""

    name: str
    outcome: Outcome | None
    """Answer of a run that is over; None for a bank, and for a run that was not finished."""
    _items: Callable[[], Iterator[tuple[float, JournalItem]]]

    def items(self) -> Iterator[tuple[float, JournalItem]]:
        """Its items, each with its time in seconds since the first; frames of a bank are read one at a time.

        Raises `RecordError` or `AcquisitionError` if a frame of a bank cannot be read.
        """
        after_s, before_s = 0.0, None
        for time_s, item in self._items():
            # The clock of a run that was resumed in another process starts again.
            after_s += max(0.0, time_s - (time_s if before_s is None else before_s))
            before_s = time_s
            yield after_s, item


def open_recording(path: Path) -> Recording:
    """The recording in a file.

    ``path``: a journal, also of a run that was not finished, or a bank.
    """
    if is_journal(path):
        recorded = read_journal(path)
        return Recording(name=path.name, outcome=_outcome(recorded), _items=partial(_journal_items, recorded))
    return Recording(name=path.name, outcome=None, _items=partial(_bank_items, replayed(path), read_bank(path)))


def _outcome(recorded: RecordedRun) -> Outcome | None:
    try:
        result = RunView.of(recorded).result()
    except SearchError:
        return None
    return Outcome(exit_code=0 if result.found else 3, answer=msgspec.to_builtins(result))


def _journal_items(recorded: RecordedRun) -> Iterator[tuple[float, JournalItem]]:
    yield recorded.entries[0].clock_s if recorded.entries else 0.0, recorded.configuration
    yield from ((entry.clock_s, entry) for entry in recorded.entries)


def _bank_items(rig: Rig, bank: IntensityBank | FrameBank) -> Iterator[tuple[float, JournalItem]]:
    """A scan as an exhaustive search that does not end at the marker, in the order of time."""
    series = series_of(bank)
    plan = SearchPlan(method="exhaustive", start_deg=series.angles_deg[0], stay=True)
    yield series.times_s[0], configuration_of(rig, plan)
    for number, (index, time_s) in enumerate(zip(series.order, series.times_s, strict=True), start=1):
        event = Measured(role="search", index=number, sample=_sample(rig, bank, index))
        yield time_s, Entry(number=number, written="", clock_s=time_s, event=event)


def _sample(rig: Rig, bank: IntensityBank | FrameBank, index: int) -> Sample:
    angle_deg = bank.angles_deg[index]
    if isinstance(bank, IntensityBank) or rig.imaging is None:
        return Sample(angle_deg=angle_deg, reading=Reading(intensity=bank.intensities[index]))
    frame = bank.frame(index)
    return Sample(angle_deg=angle_deg, reading=rig.imaging.read(frame), frame=frame)
