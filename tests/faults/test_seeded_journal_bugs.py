"""Bugs seeded into the journal, each detected by its check."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.faults.journal_checks import (
    a_changed_configuration_is_refused,
    a_changed_row_is_refused,
    a_commit_is_on_the_disk,
    a_deleted_journal_is_noticed,
    a_foreign_rollback_journal_changes_nothing,
    a_journal_is_not_written_over,
    a_lost_end_is_refused,
    a_newer_journal_is_refused,
    a_number_that_is_not_finite_is_refused,
    a_signal_behind_a_commit_leaves_room_for_a_note,
    changed_samples_are_refused,
    every_row_is_read,
    what_is_handed_out_is_on_the_disk,
)
from tests.faults.seeding import Bug, caught

JOURNAL_BUGS = {
    "a noise of NaN written as not known": Bug(
        where="records.journal.encoding:require_finite",
        old="not math.isfinite(number)",
        new="False",
        check=a_number_that_is_not_finite_is_refused,
    ),
    "a commit forgotten that a signal followed": Bug(
        where="records.journal.writer:Journal._settle",
        old="if committed:",
        new="if False:",
        check=a_signal_behind_a_commit_leaves_room_for_a_note,
    ),
    "a rollback journal undone in the file itself": Bug(
        where="records.journal.writer:Journal.reopen",
        old="recorded = read_journal(path)",
        new="connect(path, mode='rw').execute('SELECT 1 FROM run').connection.close()\n"
        "    recorded = read_journal(path)",
        check=a_foreign_rollback_journal_changes_nothing,
    ),
    "a lost end not looked for": Bug(
        where="records.journal.reader:iterate",
        old="if (entries, last) != (number, previous):",
        new="if False:",
        check=a_lost_end_is_refused,
    ),
    "a newer version read": Bug(
        where="records.journal.schema:require_schema",
        old="version > VERSION",
        new="False",
        check=a_newer_journal_is_refused,
    ),
    "a deleted file written on": Bug(
        where="records.journal.file_identity:FileIdentity.loss",
        old="if _identity(self._path) != self._file:",
        new="if False:",
        check=a_deleted_journal_is_noticed,
    ),
    "an event handed out before it is kept": Bug(
        where="runs.journalled:journalled",
        old="commit_event(event, clock, rig, journal)\n            yield event",
        new="yield event\n            commit_event(event, clock, rig, journal)",
        check=what_is_handed_out_is_on_the_disk,
    ),
    "a transaction that is not committed": Bug(
        where="records.journal.schema:_transact",
        old='connection.execute("COMMIT")',
        new='connection.execute("COMMIT" if "INTO events" not in statements[0][0] else "ROLLBACK")',
        check=a_commit_is_on_the_disk,
    ),
    "a row's checksum not looked at": Bug(
        where="records.journal.reader:_checked_row",
        old="row_checksum(previous, row, samples) != row.checksum",
        new="False",
        check=a_changed_row_is_refused,
    ),
    "samples outside the checksum": Bug(
        where="records.journal.schema:row_checksum",
        old='samples or b""',
        new='b""',
        check=changed_samples_are_refused,
    ),
    "the configuration's checksum not looked at": Bug(
        where="records.journal.reader:read_configuration",
        old="checksum(0, row[0].encode()) != row[1]",
        new="False",
        check=a_changed_configuration_is_refused,
    ),
    "a row skipped on reading": Bug(
        where="records.journal.reader:iterate",
        old="yield entry, row.checksum",
        new="if number != 2:\n            yield entry, row.checksum",
        check=every_row_is_read,
    ),
    "a journal written over": Bug(
        where="records.journal.writer:Journal.create",
        old='path.open("xb").close()',
        new='path.open("wb").close()',
        check=a_journal_is_not_written_over,
    ),
}


@pytest.mark.parametrize("name", JOURNAL_BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    assert caught(JOURNAL_BUGS[name])


@pytest.mark.parametrize(
    "check", dict.fromkeys(bug.check for bug in JOURNAL_BUGS.values()), ids=lambda check: check.__name__
)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()
