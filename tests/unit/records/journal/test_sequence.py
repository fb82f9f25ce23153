"""Impossible sequences of entries in a journal are detected."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest

from markerseek.core import Asked, ByHand, RecordError
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


def test_a_probe_that_a_hand_holds_may_drift_as_far_out_of_the_range_as_the_guard_allows(tmp_path: Path) -> None:
    """By 0.2° it did at an end, and the search could not be resumed: its journal was called damaged."""
    for number, (by_hand, angle_deg, whole) in enumerate(
        ((None, -35.2, False), (ByHand(), -35.2, True), (ByHand(), -36.4, False))
    ):
        path = tmp_path / f"{number}.journal"
        with Journal.create(path, configuration(by_hand=by_hand)) as journal:
            journal.commit(EVENTS["started"], clock_s=0.0)
            journal.commit(Asked(role="search", index=1, angle_deg=-35.0), clock_s=0.0)
            journal.commit(measured(1, angle_deg=angle_deg), clock_s=1.0)
        assert (verify(path).faults == []) is whole
        with nullcontext() if whole else pytest.raises(RecordError, match="lies outside"):
            Journal.reopen(path)[0].close()
