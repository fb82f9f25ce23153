"""What was changed in a journal is noticed: rows, their order, and the log of a run that died."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from made_up_journals import EVENTS, configuration, counts, died, measured, whole_run, write
from markerseek.core import Asked, RecordError
from markerseek.records.journal import Journal, read_journal, salvage, verify
from markerseek.records.journal.entries import Happening
from markerseek.records.journal.log import commits


def changed(path: Path, sql: str) -> None:
    with closing(sqlite3.connect(path)) as database:
        database.execute(sql)
        database.commit()


@pytest.mark.parametrize(
    ("sql", "readable", "said"),
    [
        ("DELETE FROM events WHERE number = 4", 3, "entry 4 is missing"),
        ("UPDATE events SET samples = zeroblob(1024) WHERE number = 5", 4, r"entry 5 \(measured\) does not agree"),
        ("UPDATE events SET body = replace(body, '1.1', '1.2') WHERE number = 2", 1, r"entry 2 \(asked\) does not"),
        ("UPDATE events SET clock_s = 0.25 WHERE number = 3", 2, r"entry 3 \(measured\) does not agree"),
        ("UPDATE events SET checkpoint = NULL WHERE number = 3", 2, r"entry 3 \(measured\) does not agree"),
        ("UPDATE events SET kind = 7 WHERE number = 3", 2, r"entry 3 \(7\) does not agree"),
        ("UPDATE events SET body = x'00ff' WHERE number = 3", 2, "entry 3 is damaged"),
    ],
)
def test_a_changed_row_is_noticed_and_those_before_stay_readable(
    sql: str, readable: int, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    whole_run(path, counts_of=lambda index: counts(seed=index))
    changed(path, sql)
    with pytest.raises(RecordError, match=said):
        read_journal(path)
    held, damage = salvage(path)
    assert (len(held.entries), damage is not None) == (readable, True)
    finding = verify(path)
    assert finding.entries == readable
    assert len(finding.faults) == 1


ORDERS = {
    "asked twice": ("started", "asked", "asked"),
    "measured unasked": ("started", "measured"),
    "begun twice": ("started", "started"),
    "begun late": ("asked", "measured"),
    "beyond the end": ("started", "finished", "asked"),
    "on after an interruption": ("started", "asked", "interrupted", "measured"),
    "on after a fault": ("started", "asked", "failed", "measured"),
    "checked without resuming": ("started", "checked"),
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS.keys())
def test_an_impossible_order_is_noticed(order: tuple[str, ...], tmp_path: Path) -> None:
    events: dict[str, Happening] = {
        **EVENTS,
        "asked": Asked(role="search", index=1, angle_deg=1.1),
        "measured": measured(1),
        "finished": EVENTS["NotFound"],
    }
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        for kind in order:
            journal.commit(events[kind], clock_s=0.0)
    faults = verify(path).faults
    assert faults
    assert all(fault.startswith("entry ") for fault in faults)


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
