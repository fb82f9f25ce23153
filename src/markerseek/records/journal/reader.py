"""Reads a journal and checks every entry; a run that died has all entries that were committed.

`read_journal` refuses a damaged journal, `salvage` reads its undamaged beginning and names the damage, and
`follow_journal` reads a journal while it is written.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from msgspec.structs import replace

from markerseek.core import RecordError, Started
from markerseek.records.journal.entries import Configuration, JournalEntry, without_frame
from markerseek.records.journal.file import as_journal_error, is_written, open_for_reading
from markerseek.records.journal.growing import await_file, yield_new
from markerseek.records.journal.lines import EntryReader, UnfinishedError

JournalItem: TypeAlias = Configuration | JournalEntry
"""What a journal holds: the configuration first, then the entries."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """Configuration and entries of one run, as read from its journal."""

    path: Path
    configuration: Configuration
    """Plan, rig and versions of the run."""
    entries: tuple[JournalEntry, ...]
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
    path: Path, *, frames: bool = True, on_entry: Callable[[JournalEntry], object] | None = None
) -> tuple[RecordedRun, RecordError | None]:
    """Read the undamaged beginning of a journal; returns it with the error of the first damaged entry, or None.

    ``on_entry``: called with each entry as it is read, with its frame. Raises `RecordError` if not even the
    configuration can be read, or a newer program wrote it.
    """
    entries: list[JournalEntry] = []
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
            entries.append(entry if frames else replace(entry, event=without_frame(entry.event)))
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
    """Return whether a file holds the first line of a journal; `RecordError` if it cannot be read."""
    try:
        with _opened(path):
            return True
    except UnfinishedError:
        return False


def follow_journal(
    path: Path, *, is_over: Callable[[], bool] | None = None, wait: Callable[[], object]
) -> Iterator[JournalItem]:
    """Yield the configuration and entries of a journal, each as soon as it is written, to the last one.

    Neither the writer nor another reader is held up, and nothing is lost however slowly the items are taken.

    ``is_over``: whether no more will be written; None: once no program has it open for writing. Where it is given, the
    file need not exist yet. ``wait``: called where nothing new is there. Raises `RecordError` at the first damage.
    """
    if is_over is not None and not await_file(path, is_over=is_over, wait=wait):
        return
    with _opened(path) as reader:
        yield reader.configuration
        yield from yield_new(reader.next, is_over=is_over or (lambda: not is_written(reader.descriptor)), wait=wait)


def since_started(entries: Sequence[JournalEntry]) -> tuple[JournalEntry, ...]:
    """Return the entries since the search last began; it begins again if a check finds that the rig has changed."""
    begun = [index for index, entry in enumerate(entries) if isinstance(entry.event, Started)]
    return tuple(entries[begun[-1] :]) if begun else ()


@contextmanager
def _opened(path: Path) -> Iterator[EntryReader]:
    with as_journal_error(path, verb="read"):
        descriptor = open_for_reading(path)
        try:
            yield EntryReader(path, descriptor)
        finally:
            os.close(descriptor)
