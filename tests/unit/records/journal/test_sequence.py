"""Impossible sequences of entries in a journal are detected."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import Asked
from markerseek.records.journal import Journal, JournalEvent, verify
from tests.unit.records.journal.synthetic_journals import EVENTS, configuration, measured

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
