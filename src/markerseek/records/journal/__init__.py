"""Journals: all events of a run in one file that only grows, each on the disk before the search acts on it.

`Journal` writes, `read_journal` reads and checks, `salvage` names damage, `follow` reads while a run goes on, and
`RunView` is the state of a run after each of its events. Numbers are stored exactly.
"""

from markerseek.records.journal.entries import (
    Checked,
    Configuration,
    Entry,
    Interrupted,
    JournalEvent,
    RecordedError,
    Resuming,
    decode,
    encode,
    escaped,
    versions,
)
from markerseek.records.journal.file import (
    MAGIC,
    default_journal,
    is_journal,
    is_written,
    journals_folder,
    journals_in,
    lock,
    make_folder,
    size_bytes_of,
)
from markerseek.records.journal.line_file import LineFile
from markerseek.records.journal.lines import LineReader, line_of
from markerseek.records.journal.reader import (
    JournalItem,
    RecordedRun,
    follow,
    has_begun,
    read_journal,
    salvage,
    since_started,
)
from markerseek.records.journal.run_view import Phase, Point, RunView
from markerseek.records.journal.writer import Journal

__all__ = [
    "MAGIC",
    "Checked",
    "Configuration",
    "Entry",
    "Interrupted",
    "Journal",
    "JournalEvent",
    "JournalItem",
    "LineFile",
    "LineReader",
    "Phase",
    "Point",
    "RecordedError",
    "RecordedRun",
    "Resuming",
    "RunView",
    "decode",
    "default_journal",
    "encode",
    "escaped",
    "follow",
    "has_begun",
    "is_journal",
    "is_written",
    "journals_folder",
    "journals_in",
    "line_of",
    "lock",
    "make_folder",
    "read_journal",
    "salvage",
    "since_started",
    "size_bytes_of",
    "versions",
]
