"""Reads a journal and checks every entry; a run that died has all entries that were committed.

`read_journal` refuses a damaged journal, `salvage` reads its undamaged beginning and names the damage, `follow` reads a
journal while it is written, and `summary` is its line in a list.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec

from markerseek.core import Failed, Finished, Measured, RecordError, Refused, Sample, Started
from markerseek.records.journal.entries import Checked, Configuration, Entry, Resuming, escaped
from markerseek.records.journal.file import as_record_error, is_written, open_for_reading, size_bytes_of
from markerseek.records.journal.lines import EntryReader, UnfinishedError
from markerseek.records.words import answer_line, answer_name

JournalItem: TypeAlias = Configuration | Entry
"""What a journal holds: the configuration first, then the entries."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """Configuration and entries of one run, as read from its journal."""

    path: Path
    configuration: Configuration
    """Plan, rig and versions of the run."""
    entries: tuple[Entry, ...]
    """The entries, in order."""
    is_written: bool = False
    """Whether a program was writing it."""
    unfinished_bytes: int = 0
    """Bytes behind the entries, of one that was never finished; they are ignored."""


def read_journal(path: Path, *, frames: bool = True) -> RecordedRun:
    """Read a whole journal.

    ``frames``: whether to keep the frames of the acquisitions, half a megabyte each; they are checked in any case.
    """
    recorded, damage = salvage(path, frames=frames)
    if damage is not None:
        raise damage
    return recorded


def salvage(
    path: Path, *, frames: bool = True, on_entry: Callable[[Entry], object] | None = None
) -> tuple[RecordedRun, RecordError | None]:
    """Read the undamaged beginning of a journal; returns it with the error of the first damaged entry, or None.

    ``on_entry``: called with each entry as it is read, with its frame. Raises `RecordError` if not even the
    configuration can be read, or a newer program wrote it.
    """
    entries: list[Entry] = []
    damage: RecordError | None = None
    with _opened(path) as reader:
        while True:
            try:
                entry = reader.next()
            except RecordError as problem:
                damage = problem
                break
            if entry is None:
                break
            # Outside of the try: an error of the caller is no damage of the journal.
            if on_entry is not None:
                on_entry(entry)
            # A search of 40 acquisitions has 20 MB of frames; a list of many journals needs none of them.
            entries.append(entry if frames else _without_frame(entry))
        written = is_written(reader.descriptor)
        recorded = RecordedRun(
            path=path,
            configuration=reader.configuration,
            entries=tuple(entries),
            is_written=written,
            # What a program is writing right now will be finished.
            unfinished_bytes=0 if damage or written else os.fstat(reader.descriptor).st_size - reader.end,
        )
    return recorded, damage


def has_begun(path: Path) -> bool:
    """Whether a file holds the first line of a journal; `RecordError` if it cannot be read."""
    try:
        with _opened(path):
            return True
    except UnfinishedError:
        return False


def follow(
    path: Path, *, is_over: Callable[[], bool] | None = None, wait: Callable[[], object]
) -> Iterator[JournalItem]:
    """Configuration and entries of a journal, each as soon as it is written, to the last one.

    Neither the writer nor another reader is held up, and nothing is lost however slowly the items are taken.

    ``is_over``: whether no more will be written; None: once no program has it open for writing. Where it is given, the
    file need not exist yet. ``wait``: called where nothing new is there. Raises `RecordError` at the first damage.
    """
    while is_over is not None and not path.exists():
        if is_over() and not path.exists():
            return
        wait()
    with _opened(path) as reader:
        yield reader.configuration
        while True:
            # Asked before the file is read: what was written before the end is read after it.
            over = not is_written(reader.descriptor) if is_over is None else is_over()
            while (entry := reader.next()) is not None:
                yield entry
            if over:
                return
            wait()


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
            case Started():
                acquisitions = 0
            case Measured(role=role):
                acquisitions += role == "search"
            case Finished():
                state = "finished"
            case Failed(error=error):
                state, fault = "fault", str(error)
            case Resuming(fault_reset=True):
                state, fault = "open", None
    return RunState(state=state, acquisitions=acquisitions, fault=fault)


def since_started(entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """The entries since the search last began; it begins again if a check finds that the rig has changed."""
    begun = [index for index, entry in enumerate(entries) if isinstance(entry.event, Started)]
    return tuple(entries[begun[-1] :]) if begun else ()


class JournalSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a list of journals; values that cannot be read are None."""

    path: str
    """The file; bytes of its name that are not Unicode are written as escapes."""
    size_bytes: int
    begun: str | None = None
    """When its run began, UTC, ISO 8601."""
    method: str | None = None
    as_published: bool | None = None
    rig: str | None = None
    emulated: tuple[str, ...] = ()
    """``method``, ``as_published``, ``rig`` and ``emulated``: the policy's name and whether it is in the paper's form,
    the kind of the rig, and its emulated devices."""
    description: str | None = None
    """The rig in words; of a simulated one also tissue and seed."""
    seed: int | None = None
    """Seed of a simulated rig."""
    state: Literal["finished", "fault", "open", "running", "damaged", "unreadable"]
    """"running" while a program writes it, "damaged" if only a part can be read, "unreadable" if nothing can."""
    answer: str | None = None
    angle_deg: float | None = None
    """``answer`` and ``angle_deg``: the answer of a run that is over, and the angle in degrees to which it points."""
    acquisitions: int | None = None
    """Acquisitions with light that the search received."""
    problem: str | None = None
    """What is wrong, in words."""

    @property
    def end(self) -> str:
        """The answer with its angle, in a line; the state of a run without an answer."""
        if self.answer is None or self.angle_deg is None:
            return self.state
        return answer_line(self.answer, self.angle_deg, as_published=bool(self.as_published))


def summary(path: Path) -> JournalSummary:
    """Summary of a journal; damage is reported in it, not raised."""
    size_bytes = size_bytes_of(path)
    name = escaped(str(path))
    try:
        recorded, damage = salvage(path, frames=False)
    except RecordError as problem:
        # One unreadable file must not hide the others of the list.
        return JournalSummary(path=name, size_bytes=size_bytes, state="unreadable", problem=_without(path, problem))
    state = run_state(recorded.entries)
    last = recorded.entries[-1].event if recorded.entries else None
    over = last if isinstance(last, Finished) else None
    return JournalSummary(
        path=name,
        size_bytes=size_bytes,
        begun=recorded.entries[0].written if recorded.entries else None,
        method=recorded.configuration.plan.method,
        as_published=recorded.configuration.plan.as_published,
        rig=recorded.configuration.facts.kind,
        emulated=recorded.configuration.facts.emulated,
        description=recorded.configuration.facts.description,
        seed=recorded.configuration.facts.seed,
        state="damaged" if damage is not None else "running" if recorded.is_written else state.state,
        answer=None if over is None else answer_name(over.estimate),
        angle_deg=None if over is None else over.estimate.mean_deg,
        acquisitions=state.acquisitions,
        problem=state.fault if damage is None else _without(path, damage),
    )


def _without(path: Path, problem: RecordError) -> str:
    # The list prints the path once, so that the message need not begin with it.
    return escaped(str(problem).removeprefix(f"{path}: "))


@contextmanager
def _opened(path: Path) -> Iterator[EntryReader]:
    with as_record_error(path, verb="read"):
        descriptor = open_for_reading(path)
        try:
            yield EntryReader(path, descriptor)
        finally:
            os.close(descriptor)


def _without_frame(entry: Entry) -> Entry:
    match entry.event:
        case Measured(sample=sample):
            return replace(entry, event=replace(entry.event, sample=replace(sample, frame=None)))
        case Finished(confirmation=Sample() as sample):
            return replace(entry, event=replace(entry.event, confirmation=replace(sample, frame=None)))
        case Refused() | Checked():
            return replace(entry, event=replace(entry.event, frame=None))
        case _:
            return entry
