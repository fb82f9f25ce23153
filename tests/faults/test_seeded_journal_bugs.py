"""Bugs seeded into the journal, each detected by its check."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.faults.journal_checks import (
    a_changed_configuration_is_refused,
    a_changed_length_is_damage_and_no_torn_end,
    a_changed_line_is_refused,
    a_commit_is_on_the_disk,
    a_deleted_journal_is_noticed,
    a_journal_is_not_written_over,
    a_newer_journal_is_refused,
    a_number_that_is_not_finite_is_refused,
    a_second_writer_is_refused,
    a_signal_behind_a_commit_leaves_room_for_a_note,
    a_torn_end_is_cut_off,
    changed_samples_are_refused,
    entries_of_another_run_are_refused,
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
        old="if os.fstat(self._descriptor).st_size >= self._uncertain.end:",
        new="if False:",
        check=a_signal_behind_a_commit_leaves_room_for_a_note,
    ),
    "a torn end written behind": Bug(
        where="records.journal.writer:Journal.reopen",
        old="os.ftruncate(descriptor, reader.end)",
        new="reader.end = os.fstat(descriptor).st_size",
        check=a_torn_end_is_cut_off,
    ),
    "a newer version read": Bug(
        where="records.journal.lines:EntryReader._configuration",
        old="first.journal > VERSION",
        new="False",
        check=a_newer_journal_is_refused,
    ),
    "a deleted file written on": Bug(
        where="records.journal.writer:Journal._require_present",
        old="status.st_nlink == 0",
        new="False",
        check=a_deleted_journal_is_noticed,
    ),
    "no lock": Bug(
        where="records.journal.file:open_for_writing",
        old="lock(descriptor)",
        new="pass",
        check=a_second_writer_is_refused,
    ),
    "an event handed out before it is kept": Bug(
        where="runs.journalled:journalled",
        old="commit_event(event, clock, rig, journal)\n            yield event",
        new="yield event\n            commit_event(event, clock, rig, journal)",
        check=what_is_handed_out_is_on_the_disk,
    ),
    "an entry that is not written": Bug(
        where="records.journal.writer:Journal.commit",
        old="_write(self._descriptor, data, at=self._tail.end)",
        new="os.ftruncate(self._descriptor, self._tail.end + len(data))",
        check=a_commit_is_on_the_disk,
    ),
    "a line's checksum not looked at": Bug(
        where="records.journal.lines:EntryReader._next_line",
        old="zlib.crc32(data[: rest_bytes + frame_bytes], check) != own",
        new="False",
        check=a_changed_line_is_refused,
    ),
    "samples outside the checksum": Bug(
        where="records.journal.lines:EntryReader._next_line",
        old="zlib.crc32(data[: rest_bytes + frame_bytes], check) != own",
        new="frame_bytes == 0 and zlib.crc32(data[: rest_bytes + frame_bytes], check) != own",
        check=changed_samples_are_refused,
    ),
    "the configuration's checksum not looked at": Bug(
        where="records.journal.lines:EntryReader._next_line",
        old="zlib.crc32(data[: rest_bytes + frame_bytes], check) != own",
        new="number > 0 and zlib.crc32(data[: rest_bytes + frame_bytes], check) != own",
        check=a_changed_configuration_is_refused,
    ),
    "lengths without a checksum": Bug(
        where="records.journal.lines:EntryReader._next_line",
        old="zlib.crc32(prefix[:_LENGTHS_BYTES], self.checksum) != numbers[3]",
        new="False",
        check=a_changed_length_is_damage_and_no_torn_end,
    ),
    "lines that are no chain": Bug(
        where="records.journal.lines:EntryReader._next_line",
        old="zlib.crc32(prefix[:_LENGTHS_BYTES], self.checksum) != numbers[3]",
        new="False",
        check=entries_of_another_run_are_refused,
    ),
    "an entry skipped on reading": Bug(
        where="records.journal.reader:salvage",
        old="entries.append(entry if frames else _without_frame(entry))",
        new="entries.append(entry) if entry.number != 2 else None",
        check=every_row_is_read,
    ),
    "a journal written over": Bug(
        where="records.journal.writer:Journal.create",
        old="path.exists() or path.is_symlink()",
        new="path.unlink(missing_ok=True)",
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
