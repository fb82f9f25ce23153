"""The log of a run that died: what SQLite takes from it, what it would pass over, and that none of it is touched."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_up_journals import RANGE, configuration, counts, died, write
from markerseek.core import Asked, RecordError, Started
from markerseek.records.journal import Journal, outline, read_journal, salvage, verify
from markerseek.records.journal.log import commits
from markerseek.records.journal.store import PAGE_BYTES, log_of

HEADER_BYTES, FRAME_BYTES = 32, 24


@pytest.fixture(scope="module")
def dead_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dead run whose five acquisitions, 12 entries in all, lie in the log."""
    path = tmp_path_factory.mktemp("log") / "run.journal"
    died(path, lambda journal: write(journal, 5, lambda index: counts(32, 1040, seed=index)))
    return path


def with_log(journal: Path, log: bytes, folder: Path) -> Path:
    shutil.copyfile(journal, folder / "run.journal")
    (folder / "run.journal-wal").write_bytes(log)
    return folder / "run.journal"


def by_sqlite(path: Path) -> int:
    """Number of transactions that SQLite itself makes out: one for the tables, one an entry."""
    with closing(sqlite3.connect(path)) as database:
        tables = database.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
        return 1 + database.execute("SELECT count(*) FROM events").fetchone()[0] if tables else 0


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 1))
def test_commits_in_a_torn_log_are_those_that_sqlite_takes(
    share: float, dead_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    log = Path(f"{dead_run}-wal").read_bytes()
    torn = log[: round(share * len(log))]
    good, lost = commits(BytesIO(torn))
    assert lost == 0
    path = with_log(dead_run, torn, tmp_path_factory.mktemp("torn"))
    if good:
        assert len(read_journal(path).entries) == good - 1
    assert by_sqlite(path) == good


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_in_the_log_is_no_silent_loss(
    share: float, bit: int, dead_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    flipped = bytearray(Path(f"{dead_run}-wal").read_bytes())
    place = int(share * len(flipped))
    flipped[place] ^= 1 << bit
    good, _ = commits(BytesIO(flipped))
    path = with_log(dead_run, bytes(flipped), tmp_path_factory.mktemp("flipped"))
    whole = 13
    if good < whole - 1:
        with pytest.raises(RecordError, match="log is damaged"):
            read_journal(path)
    else:
        # of the last transaction it cannot be told whether it was torn or flipped
        assert len(read_journal(path).entries) == good - 1
    assert by_sqlite(path) == good


@pytest.fixture(scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dead run of eight small entries, each of which changes a page or two; from the second on it has four pages."""

    def ask(journal: Journal) -> None:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        for index in range(1, 8):
            state = b"1," * (8500 if index == 1 else 300)
            journal.commit(Asked(role="search", index=index, angle_deg=1.1), clock_s=0.0, checkpoint=state)

    path = tmp_path_factory.mktemp("small") / "run.journal"
    died(path, ask)
    return path


def flipped_logs(log: bytes, places: range) -> Iterator[tuple[int, bytes]]:
    """A log with each bit of some bytes flipped."""
    for place in places:
        for bit in range(8):
            flipped = bytearray(log)
            flipped[place] ^= 1 << bit
            yield 8 * place + bit, bytes(flipped)


def frame_starts(log: bytes) -> range:
    return range(HEADER_BYTES, len(log), FRAME_BYTES + PAGE_BYTES)


def test_no_flipped_bit_of_a_frames_header_takes_more_than_the_last_commit_without_a_word(
    small_run: Path, tmp_path: Path
) -> None:
    log = log_of(small_run).read_bytes()
    whole, _ = commits(BytesIO(log))
    assert whole == 9
    sizes = [int.from_bytes(log[start + 4 : start + 8], "big") for start in frame_starts(log)]
    assert any(size > 0 and size & (size - 1) == 0 for size in sizes), "one bit must be able to take an end's mark away"
    for start in frame_starts(log):
        for bit, flipped in flipped_logs(log, range(start, start + FRAME_BYTES)):
            good, lost = commits(BytesIO(flipped))
            assert lost > 1 or good >= whole - 1, (start, bit)
            if bit % 29 == 0:
                path = with_log(small_run, flipped, tmp_path)
                assert read_or_refused(path) in {None, good - 1}
                assert by_sqlite(path) == good


def test_every_flipped_bit_of_the_logs_header_is_an_error(small_run: Path, tmp_path: Path) -> None:
    log = log_of(small_run).read_bytes()
    for bit, flipped in flipped_logs(log, range(HEADER_BYTES)):
        good, lost = commits(BytesIO(flipped))
        assert (good, lost) == (0, 9), bit
        if bit % 7 == 0:
            path = with_log(small_run, flipped, tmp_path)
            assert read_or_refused(path) is None


def test_no_flipped_byte_of_a_page_takes_more_than_the_last_commit_without_a_word(small_run: Path) -> None:
    log = log_of(small_run).read_bytes()
    whole, _ = commits(BytesIO(log))
    for start in frame_starts(log):
        for offset in range(FRAME_BYTES, FRAME_BYTES + PAGE_BYTES, 509):
            flipped = bytearray(log)
            flipped[start + offset] ^= 0xFF
            good, lost = commits(BytesIO(flipped))
            assert lost > 1 or good >= whole - 1


def read_or_refused(path: Path) -> int | None:
    """Number of entries that are read; None where the log is called damaged."""
    try:
        return len(read_journal(path).entries)
    except RecordError:
        with pytest.raises(RecordError, match="log is damaged"):
            read_journal(path)
        return None


def files_of(folder: Path) -> dict[str, bytes]:
    return {each.name: each.read_bytes() for each in folder.iterdir()}


@pytest.mark.parametrize(("where", "readable"), [("header", None), ("second entry", 1), ("last but one", 6)])
def test_a_damaged_log_is_refused_and_nothing_is_folded_in_or_removed(
    where: str, readable: int | None, small_run: Path, tmp_path: Path
) -> None:
    log = bytearray(log_of(small_run).read_bytes())
    starts = frame_starts(bytes(log))
    place = {"header": 17, "second entry": starts[5] + FRAME_BYTES + 99, "last but one": starts[-2] + 9}[where]
    log[place] ^= 1
    path = with_log(small_run, bytes(log), tmp_path)
    before = files_of(tmp_path)
    for look in (Journal.reopen, read_journal, *((salvage, verify) if readable is None else ())):
        with pytest.raises(RecordError, match="log is damaged"):
            look(path)
        assert files_of(tmp_path) == before
    if readable is not None:
        held, damage = salvage(path)
        assert "log is damaged" in str(damage)
        assert [entry.event for entry in held.entries] == [e.event for e in read_journal(small_run).entries[:readable]]
        finding = verify(path)
        assert finding.entries == readable
        assert "log is damaged" in finding.faults[0]
        assert outline(path).state == "damaged"
    assert files_of(tmp_path) == before


def test_a_refused_reopening_folds_nothing_in(small_run: Path, tmp_path: Path) -> None:
    """The log is whole; what it holds is of a version that is not ours."""
    path = with_log(small_run, log_of(small_run).read_bytes(), tmp_path)
    with closing(sqlite3.connect(path)) as database, closing(sqlite3.connect(path)) as holds_the_log:
        holds_the_log.execute("SELECT count(*) FROM run").fetchone()
        database.execute("PRAGMA user_version = 1000")
        kept = {name: data for name, data in files_of(tmp_path).items() if not name.endswith("-shm")}
    folder = tmp_path / "newer"
    folder.mkdir()
    for name, data in kept.items():
        (folder / name).write_bytes(data)
    before = files_of(folder)
    assert len(before) == 2
    for look in (Journal.reopen, read_journal):
        with pytest.raises(RecordError, match="has version 1000"):
            look(folder / "run.journal")
        assert files_of(folder) == before


def test_a_torn_end_is_dropped_and_the_run_goes_on(small_run: Path, tmp_path: Path) -> None:
    path = with_log(small_run, log_of(small_run).read_bytes()[:-5000], tmp_path)
    journal, held = Journal.reopen(path)
    with journal:
        journal.interrupt("made up")
    assert len(held.entries) == 7
    assert len(read_journal(path).entries) == 8
    assert not log_of(path).exists()


@pytest.mark.parametrize("keep", [0, 32, 40, 5000])
def test_a_log_without_a_whole_commit_is_passed_over_and_not_removed_by_readers(
    keep: int, small_run: Path, tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    Journal.create(path, configuration()).close()
    log_of(path).write_bytes(log_of(small_run).read_bytes()[:keep])
    before = files_of(tmp_path)
    assert read_journal(path).entries == ()
    assert verify(path).faults == []
    assert files_of(tmp_path) == before


@pytest.mark.parametrize("entries", [30, 47])
def test_a_log_that_was_begun_again_is_read_up_to_what_is_left_of_the_one_before(entries: int, tmp_path: Path) -> None:
    """As programs of version 1 did it, which folded the log in now and then and wrote on from its beginning."""

    def ask(journal: Journal) -> None:
        journal._connection.execute("PRAGMA wal_autocheckpoint = 20")
        for index in range(entries):
            journal.commit(Asked(role="search", index=index, angle_deg=1.1), clock_s=0.0)

    path = tmp_path / "run.journal"
    died(path, ask)
    log = log_of(path).read_bytes()
    salts = {log[start + 8 : start + 16] for start in frame_starts(log)}
    assert len(salts) == 2
    good, lost = commits(BytesIO(log))
    assert 0 < good < entries
    assert lost <= 1
    assert len(read_journal(path).entries) == entries


def test_an_empty_file_does_not_cost_its_log(small_run: Path, tmp_path: Path) -> None:
    """SQLite removes the log of an empty file as soon as it looks at it."""
    path = with_log(small_run, log_of(small_run).read_bytes(), tmp_path)
    path.write_bytes(b"")
    before = files_of(tmp_path)
    for look in (Journal.reopen, read_journal, verify):
        with pytest.raises(RecordError, match=r"it is empty: no journal of a run.*-wal is left as it is"):
            look(path)
        assert files_of(tmp_path) == before


def test_a_log_without_its_file_is_not_written_over(small_run: Path, tmp_path: Path) -> None:
    path = with_log(small_run, log_of(small_run).read_bytes(), tmp_path)
    path.unlink()
    before = files_of(tmp_path)
    with pytest.raises(RecordError, match="the log of a journal that is gone lies there"):
        Journal.create(path, configuration())
    assert files_of(tmp_path) == before
