"""Journals: all events of a run in one file that only grows, each on the disk before the search acts on it.

`Journal` writes, `read_journal` reads and checks, `salvage` names damage, `follow_journal` reads while a run goes on,
and `RunView` is the state of a run after each of its events. Numbers are stored exactly.
"""

from markerseek.records.journal.entries import (
    Checked,
    Configuration,
    Interrupted,
    JournalEntry,
    JournalEvent,
    RecordedError,
    Resuming,
    decode_entry,
    encode_entry,
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
from markerseek.records.journal.growing import await_file, yield_new
from markerseek.records.journal.line_file import LineFile
from markerseek.records.journal.lines import LineReader, line_of
from markerseek.records.journal.reader import (
    JournalItem,
    RecordedRun,
    follow_journal,
    has_begun,
    read_journal,
    salvage,
    since_started,
)
from markerseek.records.journal.run_view import LitAcquisition, RunPhase, RunView
from markerseek.records.journal.writer import Journal

__all__ = [
    "MAGIC",
    "Checked",
    "Configuration",
    "Interrupted",
    "Journal",
    "JournalEntry",
    "JournalEvent",
    "JournalItem",
    "LineFile",
    "LineReader",
    "LitAcquisition",
    "RecordedError",
    "RecordedRun",
    "Resuming",
    "RunPhase",
    "RunView",
    "await_file",
    "decode_entry",
    "default_journal",
    "encode_entry",
    "escaped",
    "follow_journal",
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
    "yield_new",
]
