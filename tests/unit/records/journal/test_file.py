"""Journals under other names, and journals deleted or replaced while a run is being written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.guard import State
from markerseek.records.journal import Journal, is_journal, read_journal, summary, verify
from markerseek.runs.journalled import journalled
from tests.unit.records.journal.synthetic_journals import configuration, died_in_commit, write
from tests.unit.runs.journalled_runs import begin, times_and_events


def test_a_dead_run_is_read_through_a_symbolic_link(tmp_path: Path) -> None:
    path, link = tmp_path / "run.journal", tmp_path / "latest.journal"
    died_in_commit(path, lambda journal: write(journal, 2))
    link.symlink_to(path)
    assert len(read_journal(link).entries) == 6
    assert verify(link).entries == 6
    assert is_journal(link)
    assert summary(link).acquisitions == summary(path).acquisitions
    assert summary(link).size_bytes == summary(path).size_bytes
    journal, held = Journal.reopen(link)
    with journal:
        assert (held.path, len(held.entries)) == (link, 6)


def removed(path: Path) -> None:
    path.unlink()


def replaced(path: Path) -> None:
    copy = shutil.copy(path, path.with_name("copy"))
    Path(copy).replace(path)


def folder_removed(path: Path) -> None:
    shutil.rmtree(path.parent)


@pytest.mark.parametrize("lose", [removed, replaced, folder_removed])
def test_a_journal_that_is_lost_in_mid_run_stops_it(lose: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "runs" / "run.journal"
    path.parent.mkdir()
    policy, rig, configured = begin()
    journal = Journal.create(path, configured)
    events = journalled(policy, rig, journal)
    for _ in range(9):
        next(events)
    lose(path)
    with pytest.raises(RecordError, match="removed or replaced while the run was written"):
        next(events)
    journal.close()
    assert rig.scanner.guard.state not in {State.FIRING, State.MOVING}


def test_a_journal_that_is_lost_after_the_last_commit_is_noticed_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    journal = Journal.create(path, configuration())
    write(journal, 2)
    removed(path)
    with pytest.raises(RecordError, match="it was removed or replaced while the run was written"):
        journal.close()
    journal.close()


def test_a_journal_that_is_moved_in_mid_run_goes_on_in_its_new_place(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configured = begin()
    with Journal.create(path, configured) as journal:
        events = journalled(policy, rig, journal)
        for _ in range(9):
            next(events)
        path.rename(tmp_path / "elsewhere")
        list(events)
    assert times_and_events(read_journal(tmp_path / "elsewhere")) == times_and_events(read_journal(whole))


@pytest.mark.parametrize("change", [lambda size: size - 1, lambda size: 100, lambda size: 0, lambda size: size + 1])
def test_a_journal_that_another_program_changes_in_mid_run_stops_it(
    change: Callable[[int], int], tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configured = begin()
    journal = Journal.create(path, configured)
    events = journalled(policy, rig, journal)
    for _ in range(9):
        next(events)
    size = path.stat().st_size
    os.truncate(path, change(size))
    with pytest.raises(RecordError, match=f"another program changed it while the run was written: .*{size} were"):
        next(events)
    assert rig.scanner.guard.state not in {State.FIRING, State.MOVING}
    journal.close()
