"""Reading a journal, with or without its frames, also while it is written: nobody waits, and nothing is lost."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from markerseek.core import Asked, Finished, Measured, RecordError, Refused, Started
from markerseek.records.journal import (
    Checked,
    Configuration,
    Journal,
    JournalEntry,
    JournalItem,
    follow_journal,
    read_journal,
    salvage,
)
from markerseek.runs import journal_summary
from tests.unit.records.journal.synthetic_journals import (
    RANGE,
    configuration,
    counts,
    died_in_commit,
    journal_events,
    measured,
    whole_run,
    write,
)
from tests.waiting import wait_until

ACQUISITIONS = 40
FRAME_BYTES = 2 * 128 * 2080


@pytest.fixture(scope="module")
def long_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "run.journal"
    samples = counts(128, 2080)
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
    seen: list[JournalEntry] = []
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


Shell = Callable[..., tuple[int, str, str]]

FOLLOW = [sys.executable, "-P", "-m", "markerseek", "journal", "follow"]


def nap() -> None:
    time.sleep(0.001)


def entries_of(items: list[JournalItem]) -> list[tuple[object, ...]]:
    assert isinstance(items[0], Configuration)
    return [(each.number, each.event, each.clock_s) for each in items[1:] if isinstance(each, JournalEntry)]


def test_two_followers_get_all_of_it_and_one_that_stands_still_holds_nobody_up(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    received: list[list[JournalItem]] = [[], []]
    released = threading.Event()

    def read(number: int) -> None:
        for item in follow_journal(path, is_over=over.is_set, wait=nap):
            received[number].append(item)
            if number == 1:
                released.wait(60)

    over = threading.Event()
    threads = [threading.Thread(target=read, args=(number,)) for number in (0, 1)]
    for each in threads:
        each.start()
    with Journal.create(path, configuration()) as journal:
        write(journal, 20, lambda index: counts(64, 500, seed=index))
        wait_until(lambda: len(received[0]) >= 43)
    assert len(received[1]) == 1
    over.set()
    released.set()
    for each in threads:
        each.join()
    wanted = [(each.number, each.event, each.clock_s) for each in read_journal(path).entries]
    assert entries_of(received[0]) == entries_of(received[1]) == wanted
    frames = [each.event.sample.frame.samples for each in received[1] if hasattr(getattr(each, "event", 0), "sample")]
    assert all((frame == counts(64, 500, seed=index)).all() for index, frame in enumerate(frames, start=1))


def test_a_follower_sees_a_run_die_and_go_on(tmp_path: Path) -> None:
    """The entry that was never finished is cut off, and another one takes its place."""
    path = tmp_path / "run.journal"
    died_in_commit(path, lambda journal: journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0))
    over = threading.Event()
    with closing(follow_journal(path, is_over=over.is_set, wait=nap)) as items:
        assert isinstance(next(items), Configuration)
        assert isinstance(next(items).event, Started)
        journal, _ = Journal.reopen(path)
        with journal:
            journal.commit(Asked(role="search", index=1, angle_deg=1.1), clock_s=1.0)
            assert isinstance(next(items).event, Asked)
            journal.commit(measured(1, counts=counts()), clock_s=2.0)
            assert next(items).number == 3
        over.set()
        assert list(items) == []


def test_damage_ends_it_with_an_error(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        write(journal, 2)
    data = bytearray(path.read_bytes())
    data[-3] ^= 1
    path.write_bytes(data)
    items = follow_journal(path, wait=nap)
    assert sum(1 for _ in zip(range(6), items, strict=False)) == 6
    with pytest.raises(RecordError, match="entry 6: its line does not agree with its checksum; it is damaged"):
        next(items)


def test_the_command_prints_what_journal_show_does(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        write(journal, 2, lambda index: counts(seed=index))
    _, shown, _ = shell("journal", "show", path, "--json")
    done = subprocess.run([*FOLLOW, str(path)], capture_output=True, check=True)
    first, *lines = map(json.loads, done.stdout.splitlines())
    assert lines == json.loads(shown)["entries"]
    assert first["configuration"]["plan"]["method"] == "golden-section"


def test_events_without_a_journal_go_to_a_file_that_is_followed_as_one(shell: Shell, tmp_path: Path) -> None:
    events = tmp_path / "events"
    search = ("search", "--seed", 1, "--method", "ternary", "--acquisitions", 4, "--json")
    code, alone, _ = shell(*search, "--no-journal")
    again, watched, error = shell(*search, "--no-journal", "--events", events)
    assert (code, alone) == (again, watched)
    assert "journal" not in error
    assert read_journal(events).entries[-1].event.estimate.mean_deg == json.loads(alone)["angle_deg"]
    code, said, _ = shell(*search, "--journal", tmp_path / "run.journal", "--events", tmp_path / "more")
    assert (code, list(tmp_path.iterdir())) == (2, [events])
    assert "is for a run without a journal" in json.loads(said)["error"]
