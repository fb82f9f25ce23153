"""A process killed by ptrace before each write of a commit: every acknowledged event is in the journal."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from markerseek.core import Asked, Started
from markerseek.records.journal import Journal, read_journal, verify
from tests.faults.journal_runs import RANGE, commit, configuration, measured
from tests.faults.kills.tracing import around, can_trace, killed_at_write

pytestmark = pytest.mark.skipif(not can_trace(), reason="needs ptrace on Linux, x86-64")

BEFORE = 4


def test_a_commit_that_is_killed_at_any_of_its_writes_is_there_or_is_not(tmp_path: Path) -> None:
    ends: list[int] = []
    for number in range(1, 200):
        path = tmp_path / f"{number}.journal"

        def work(*, ack_fd: int, path: Path = path) -> None:
            journal = Journal.create(path, configuration())
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
            commit(journal, 1, channels=4)
            journal.commit(Asked(role="search", index=2, angle_deg=0.0), clock_s=0.0)
            around(journal.commit)(measured(2), clock_s=0.0)
            os.write(ack_fd, b".")

        end = killed_at_write(work, number)
        entries = len(read_journal(path).entries)
        assert entries in ({BEFORE, BEFORE + 1} if end.killed else {BEFORE + 1}), end.place
        assert verify(path).faults == []
        ends.append(entries)
        journal, held = Journal.reopen(path)
        with journal:
            journal.interrupt("made up")
        assert len(held.entries) == entries
        if not end.killed:
            break
    assert len(ends) > 2, "a commit of a frame is written and flushed"
    assert ends == sorted(ends)
    assert set(ends) == {BEFORE, BEFORE + 1}
