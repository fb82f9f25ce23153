"""One entry of a journal with its image, as bridges are given it."""

from __future__ import annotations

from markerseek.bridges.run_images import PicturedEntry, with_images
from markerseek.records.journal import Configuration, JournalEntry, JournalEvent

WRITTEN = "2026-03-01T12:00:00+00:00"
"""When an entry was written, unless a test says otherwise."""


def pictured_entry(
    configuration: Configuration,
    event: JournalEvent,
    *,
    number: int = 1,
    written: str = WRITTEN,
    clock_s: float = 0.0,
) -> PicturedEntry:
    """Return an entry of a run with its image, made of its frame."""
    entry = JournalEntry(number=number, written=written, clock_s=clock_s, event=event)
    _, item = with_images([configuration, entry])
    assert isinstance(item, PicturedEntry)
    return item
