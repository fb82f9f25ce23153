"""One run in one SQLite file: what was asked, measured, refused and answered, committed before the search acts on it.

`Journal` writes, `read_journal` reads and checks as it goes, `verify` looks for every kind of damage. What is written
is exact: a run can be repeated from it bit for bit.
"""

from markerseek.records.journal.answer import result_of
from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.entries import Checked, Entry, Interrupted, Resuming
from markerseek.records.journal.grammar import Standing, standing
from markerseek.records.journal.outline import Outline, journals_in, outline, size_with_log
from markerseek.records.journal.place import default_journal, journals_folder, make_folder
from markerseek.records.journal.reader import Recording, open_journal, read_journal, salvage
from markerseek.records.journal.store import is_journal
from markerseek.records.journal.verify import Finding, verify
from markerseek.records.journal.writer import Journal

__all__ = [
    "Checked",
    "Configuration",
    "Entry",
    "Finding",
    "Interrupted",
    "Journal",
    "Outline",
    "Recording",
    "Resuming",
    "Standing",
    "default_journal",
    "is_journal",
    "journals_folder",
    "journals_in",
    "make_folder",
    "open_journal",
    "outline",
    "read_journal",
    "result_of",
    "salvage",
    "size_with_log",
    "standing",
    "verify",
]
