"""Runs that died in a commit, damaged rollback journals, lost ends: only what was written is read."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import RecordError
from markerseek.records.journal import Entry, Interrupted, Journal, read_journal, salvage, summary, verify
from markerseek.records.journal.connection import rollback_file
from tests.unit.records.journal.synthetic_journals import configuration, counts, died_in_commit, whole_run, write

ACQUISITIONS = 3
ENTRIES = 2 * ACQUISITIONS + 2


@pytest.fixture(scope="module")
def dead_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that died while a ninth entry was written: that commit must be undone."""
    path = tmp_path_factory.mktemp("dead") / "run.journal"
    died_in_commit(path, lambda journal: write(journal, ACQUISITIONS, lambda index: counts(seed=index)))
    return path


@pytest.fixture(scope="module")
def entries(tmp_path_factory: pytest.TempPathFactory) -> tuple[Entry, ...]:
    """What that run holds, from a run that did not die."""
    path = tmp_path_factory.mktemp("whole") / "run.journal"
    whole_run(path, acquisitions=ACQUISITIONS, counts_of=lambda index: counts(seed=index))
    return read_journal(path).entries


def files_of(folder: Path) -> dict[str, bytes]:
    return {each.name: each.read_bytes() for each in folder.iterdir()}


def copy_to(folder: Path, dead_run: Path, *, rollback: bytes | None) -> Path:
    path = folder / "run.journal"
    shutil.copyfile(dead_run, path)
    if rollback is not None:
        rollback_file(path).write_bytes(rollback)
    return path


def require_true(path: Path, entries: tuple[Entry, ...]) -> bool:
    """Whether all was read; what was read, whole or not, must be what was written."""
    try:
        held, damage = salvage(path)
    except RecordError:
        return False
    for kept, wanted in zip(held.entries, entries, strict=False):
        assert (kept.number, kept.event, kept.clock_s, kept.checkpoint) == (
            wanted.number,
            wanted.event,
            wanted.clock_s,
            wanted.checkpoint,
        )
    assert damage is not None or len(held.entries) == len(entries)
    return damage is None


def test_a_run_that_died_in_a_commit_is_read_to_the_commit_before_and_not_touched(
    dead_run: Path, entries: tuple[Entry, ...]
) -> None:
    before = files_of(dead_run.parent)
    assert set(before) == {"run.journal", "run.journal-journal"}
    with closing(sqlite3.connect(f"file:{dead_run}?mode=ro&immutable=1", uri=True)) as database:
        assert database.execute("SELECT entries FROM run").fetchone() != (ENTRIES,), "nothing was to be undone"
    for _ in range(2):
        assert require_true(dead_run, entries)
        assert verify(dead_run).faults == []
        assert summary(dead_run).acquisitions == ACQUISITIONS
    assert files_of(dead_run.parent) == before


def test_a_run_that_died_in_a_commit_is_continued(dead_run: Path, tmp_path: Path) -> None:
    path = copy_to(tmp_path, dead_run, rollback=rollback_file(dead_run).read_bytes())
    journal, held = Journal.reopen(path)
    with journal:
        journal.commit(Interrupted(reason="made up"), clock_s=9.0)
    assert len(held.entries) == ENTRIES
    assert len(read_journal(path).entries) == ENTRIES + 1
    assert list(files_of(tmp_path)) == ["run.journal"]


def test_a_lost_rollback_journal_is_noticed(dead_run: Path, entries: tuple[Entry, ...], tmp_path: Path) -> None:
    path = copy_to(tmp_path, dead_run, rollback=None)
    before = files_of(tmp_path)
    assert not require_true(path, entries)
    for look in (read_journal, Journal.reopen):
        with pytest.raises(RecordError):
            look(path)
    assert summary(path).state in {"damaged", "unreadable"}
    assert files_of(tmp_path) == before


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0, 1))
def test_a_torn_rollback_journal_never_changes_what_is_read(
    share: float, dead_run: Path, entries: tuple[Entry, ...], tmp_path_factory: pytest.TempPathFactory
) -> None:
    rollback = rollback_file(dead_run).read_bytes()
    folder = tmp_path_factory.mktemp("torn")
    path = copy_to(folder, dead_run, rollback=rollback[: round(share * len(rollback))])
    before = files_of(folder)
    require_true(path, entries)
    assert files_of(folder) == before


@pytest.mark.parametrize("start", [0, 28, 512])
def test_no_flipped_bit_of_a_rollback_journal_changes_what_is_read(
    start: int, dead_run: Path, entries: tuple[Entry, ...], tmp_path: Path
) -> None:
    """Of its header, and of the first page that it holds: number, content, checksum."""
    rollback = rollback_file(dead_run).read_bytes()
    places = range(start, start + 28) if start < 512 else range(512, 512 + 16384 + 8, 263)
    for place in places:
        for bit in range(0, 8, 1 if start < 512 else 3):
            flipped = bytearray(rollback)
            flipped[place] ^= 1 << bit
            require_true(copy_to(tmp_path, dead_run, rollback=bytes(flipped)), entries)


def test_a_rollback_journal_of_another_file_does_no_harm(
    dead_run: Path, tmp_path: Path, entries: tuple[Entry, ...]
) -> None:
    path = tmp_path / "run.journal"
    whole_run(path, acquisitions=ACQUISITIONS, counts_of=lambda index: counts(seed=index))
    rollback_file(path).write_bytes(rollback_file(dead_run).read_bytes())
    before = files_of(tmp_path)
    require_true(path, entries)
    assert files_of(tmp_path) == before


def test_no_flipped_byte_of_a_file_changes_what_is_read(entries: tuple[Entry, ...], tmp_path: Path) -> None:
    """Every byte that is used, one bit of each in turn; frames are tried bit by bit in `test_journal_damage`."""
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        write(journal, ACQUISITIONS, lambda index: counts(2, 4, seed=index))
    whole = path.read_bytes()
    wanted = read_journal(path).entries
    assert len(wanted) == len(entries)
    for place in (place for place, value in enumerate(whole) if value):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        path.write_bytes(flipped)
        require_true(path, wanted)


@pytest.mark.parametrize(
    "sql",
    [
        f"DELETE FROM events WHERE number = {ENTRIES}",
        "DELETE FROM events WHERE number > 2",
        "UPDATE run SET entries = entries - 1",
        "UPDATE run SET last_checksum = last_checksum + 1",
        "UPDATE run SET entries = 'many'",
    ],
)
def test_a_lost_end_is_noticed(sql: str, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path, acquisitions=ACQUISITIONS)
    with closing(sqlite3.connect(path)) as database:
        database.execute(sql)
        database.commit()
    with pytest.raises(RecordError, match=r"entries were committed, and \d are there; the end .* is damaged"):
        read_journal(path)
    assert verify(path).faults


def test_a_rollback_journal_without_its_file_is_not_written_over(dead_run: Path, tmp_path: Path) -> None:
    path = copy_to(tmp_path, dead_run, rollback=rollback_file(dead_run).read_bytes())
    path.unlink()
    before = files_of(tmp_path)
    with pytest.raises(RecordError, match="the rollback journal of a file that is gone lies there"):
        Journal.create(path, configuration())
    assert files_of(tmp_path) == before


def test_an_empty_file_does_not_cost_its_rollback_journal(dead_run: Path, tmp_path: Path) -> None:
    """SQLite removes the rollback journal of an empty file as soon as it looks at it."""
    path = copy_to(tmp_path, dead_run, rollback=rollback_file(dead_run).read_bytes())
    path.write_bytes(b"")
    before = files_of(tmp_path)
    for look in (Journal.reopen, read_journal, verify):
        with pytest.raises(RecordError, match="it is empty: no journal of a run"):
            look(path)
    assert files_of(tmp_path) == before


def test_a_database_in_another_mode_is_refused_before_sqlite_makes_files_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    whole_run(path)
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
    before = files_of(tmp_path)
    for look in (Journal.reopen, read_journal, verify):
        with pytest.raises(RecordError, match="a database without rollback journal"):
            look(path)
    assert files_of(tmp_path) == before
