"""Reading a journal without frames takes little memory, however long it is; all else that it returns is the same."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import Finished, Measured, Refused
from markerseek.records.journal import Checked, Entry, Journal, read_journal, salvage
from markerseek.runs import journal_summary
from tests.unit.records.journal.every_kind_of_entry import journal_events
from tests.unit.records.journal.synthetic_journals import configuration, counts, died, whole_run, write

ACQUISITIONS, FRAME_BYTES = 40, 2 * 128 * 2080


@pytest.fixture(scope="module", params=["closed", "dead"])
def long_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "run.journal"
    samples = counts(128, 2080)
    if request.param == "dead":
        died(path, lambda journal: write(journal, ACQUISITIONS, lambda _: samples))
    else:
        whole_run(path, acquisitions=ACQUISITIONS, counts_of=lambda _: samples)
    return path


def most_bytes(work: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "look", [journal_summary, lambda path: salvage(path, frames=False), lambda path: read_journal(path, frames=False)]
)
def test_unused_frames_are_not_kept_in_memory(look: Callable[[Path], object], long_run: Path) -> None:
    assert most_bytes(lambda: look(long_run)) < 10 * FRAME_BYTES
    assert most_bytes(lambda: read_journal(long_run)) > ACQUISITIONS * FRAME_BYTES


def frames_of(event: object) -> list[object]:
    match event:
        case Measured(sample=sample) | Finished(confirmation=sample) if sample is not None:
            return [sample.frame]
        case Refused(frame=frame) | Checked(frame=frame):
            return [frame]
        case _:
            return []


def test_all_but_the_frames_is_the_same(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        for event in journal_events():
            journal.commit(event, clock_s=0.5)
    seen: list[Entry] = []
    held, damage = salvage(path, frames=False, on_entry=seen.append)
    assert damage is None
    whole = read_journal(path)
    assert held.configuration == whole.configuration
    assert len(held.entries) == len(whole.entries) == len(seen)
    assert [frame for entry in held.entries for frame in frames_of(entry.event) if frame is not None] == []
    assert sum(frame is not None for entry in seen for frame in frames_of(entry.event)) == 8
    for bare, full in zip(held.entries, whole.entries, strict=True):
        assert (bare.number, bare.written) == (full.number, full.written)
        if not isinstance(full.event, Checked) and type(full.event).__name__ != "Failed":
            assert bare.event == full.event
