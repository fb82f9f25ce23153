"""Changed rows and impossible sequences of entries in a journal are detected."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from markerseek.core import Asked, RecordError
from markerseek.records.journal import Journal, JournalEvent, read_journal, salvage, verify
from tests.unit.records.journal.synthetic_journals import EVENTS, configuration, counts, measured, whole_run


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
    events: dict[str, JournalEvent] = {
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
