"""Journals under other names, and journals deleted or replaced while a run is being written."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.guard import State
from markerseek.records.journal import Journal, read_journal
from markerseek.runs.journalled import journalled
from tests.unit.records.journal.synthetic_journals import configuration, write
from tests.unit.runs.journalled_runs import begin, times_and_events


def removed(path: Path) -> None:
    path.unlink()


def replaced(path: Path) -> None:
    copy = shutil.copy(path, path.with_name("copy"))
    Path(copy).replace(path)


def folder_removed(path: Path) -> None:
    shutil.rmtree(path.parent)


def cut_to(more: int | None) -> Callable[[Path], None]:
    """A file that another program makes so many bytes longer, or empty."""
    return lambda path: os.truncate(path, 0 if more is None else path.stat().st_size + more)


@pytest.mark.parametrize("harm", [removed, replaced, folder_removed, *map(cut_to, (-1, -100, None, 1))])
def test_a_journal_that_is_lost_or_changed_in_mid_run_stops_it(harm: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "runs" / "run.journal"
    path.parent.mkdir()
    policy, rig, configured = begin()
    journal = Journal.create(path, configured)
    events = journalled(policy, rig, journal)
    for _ in range(9):
        next(events)
    harm(path)
    with pytest.raises(RecordError, match="changed, removed or replaced while the run was written"):
        next(events)
    assert rig.scanner.guard.state not in {State.FIRING, State.MOVING}
    journal.close()


def test_a_journal_that_is_lost_after_the_last_commit_is_noticed_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    journal = Journal.create(path, configuration())
    write(journal, 2)
    removed(path)
    with pytest.raises(RecordError, match="it was changed, removed or replaced while the run was written"):
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
