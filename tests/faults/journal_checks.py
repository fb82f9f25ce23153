"""Properties of a journal, as checks that detect the bugs of `test_seeded_journal_bugs`."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from unittest import mock

from markerseek import rigs
from markerseek.core import Asked, Event, Interval, Measured, PolicyPlan, Reading, RecordError, Sample, Started
from markerseek.records.journal import Journal, read_journal
from markerseek.records.journal.connection import rollback_file
from markerseek.records.journal.schema import VERSION
from markerseek.runs.journalled import journalled
from markerseek.search import build
from tests.faults.journal_runs import configuration, died_in_commit, measured


@contextlib.contextmanager
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def kept(path: Path, *, acquisitions: int = 3) -> None:
    """A journal of some events."""
    with new(path) as journal:
        for event in events(acquisitions):
            journal.commit(event, clock_s=0.0)


def new(path: Path) -> Journal:
    return Journal.create(path, configuration())


def events(acquisitions: int) -> list[Event]:
    made: list[Event] = [Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0))]
    for index in range(1, acquisitions + 1):
        sample = Sample(angle_deg=0.0, reading=Reading(intensity=float(index)))
        made.append(Asked(role="search", index=index, angle_deg=0.0))
        made.append(Measured(role="search", index=index, sample=sample))
    return made


def what_is_handed_out_is_on_the_disk() -> None:
    """Each event that a run hands out can be read from a copy of the files as they are then."""
    with folder() as place:
        rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
        policy = build(PolicyPlan(method="ternary", start_deg=0.0, acquisitions=6), limits=rig.limits.search)
        with new(place / "a") as journal, closing(journalled(policy, rig, journal)) as run:
            for count, _ in enumerate(run, start=1):
                assert len(copied(place)) >= count


def a_commit_is_on_the_disk() -> None:
    with folder() as place, new(place / "a") as journal:
        for count, event in enumerate(events(2), start=1):
            with contextlib.suppress(RecordError):
                journal.commit(event, clock_s=0.0)
            assert len(copied(place)) == count


def copied(place: Path) -> list[object]:
    """Entries in a copy of the journal and its rollback journal, as after a sudden death."""
    for copy_of in (lambda path: path, rollback_file):
        shutil.copyfile(copy_of(place / "a"), copy_of(place / "b"))
    return list(read_journal(place / "b").entries)


def unreadable_after(*statements: str) -> bool:
    """Whether a journal, of which the last event has a frame, is refused after these changes."""
    with folder() as place:
        with new(place / "a") as journal:
            for event in (*events(2), measured(3, channels=2)):
                journal.commit(event, clock_s=0.0)
        with closing(sqlite3.connect(place / "a")) as connection:
            for sql in statements:
                connection.execute(sql)
            connection.commit()
        try:
            read_journal(place / "a")
        except RecordError:
            return True
        return False


def a_changed_row_is_refused() -> None:
    assert unreadable_after("UPDATE events SET clock_s = 9 WHERE number = 3")


def changed_samples_are_refused() -> None:
    assert unreadable_after("UPDATE events SET samples = zeroblob(length(samples)) WHERE samples NOT NULL")


def a_changed_configuration_is_refused() -> None:
    assert unreadable_after("UPDATE run SET configuration = replace(configuration, 'ternary', 'Ternary')")


def every_row_is_read() -> None:
    with folder() as place:
        kept(place / "a")
        try:
            entries = read_journal(place / "a").entries
        except RecordError as refusal:
            raise AssertionError("a sound journal is refused") from refusal
        assert [type(entry.event) for entry in entries] == [type(event) for event in events(3)]


def a_journal_is_not_written_over() -> None:
    with folder() as place:
        kept(place / "a")
        with contextlib.suppress(RecordError):
            new(place / "a").close()
        assert (place / "a").stat().st_size > 0
        assert read_whole(place / "a") == len(events(3))


def read_whole(path: Path) -> int:
    try:
        return len(read_journal(path).entries)
    except RecordError:
        return -1


def a_number_that_is_not_finite_is_refused() -> None:
    with folder() as place, new(place / "a") as journal:
        try:
            reading = Reading(intensity=1.0)
            object.__setattr__(reading, "noise_sigma", float("nan"))
            sample = Sample(angle_deg=0.0, reading=reading)
            journal.commit(Measured(role="search", index=1, sample=sample), clock_s=0.0)
        except RecordError:
            return
        raise AssertionError("a NaN noise is read as an unknown noise")


def a_signal_behind_a_commit_leaves_room_for_a_note() -> None:
    def struck(*_: object) -> None:
        raise KeyboardInterrupt

    with folder() as place, new(place / "a") as journal:
        journal.commit(events(1)[0], clock_s=0.0)
        with contextlib.suppress(KeyboardInterrupt), mock.patch.object(Journal, "_note", struck):
            journal.commit(events(1)[1], clock_s=0.0)
        with contextlib.suppress(RecordError):
            journal.interrupt("made up")
        journal.close()
        assert read_whole(place / "a") == 3


def a_lost_end_is_refused() -> None:
    assert unreadable_after("DELETE FROM events WHERE number > 5")


def a_foreign_rollback_journal_changes_nothing() -> None:
    """It is undone in a copy, and a journal that is not whole after that is not opened to be written."""
    with folder() as place:
        kept(place / "a", acquisitions=20)
        died_in_commit(place / "b", lambda journal: journal.commit(events(1)[0], clock_s=0.0))
        rollback_file(place / "b").replace(rollback_file(place / "a"))
        before = (place / "a").read_bytes()
        with contextlib.suppress(RecordError):
            Journal.reopen(place / "a")[0].close()
        assert (place / "a").read_bytes() == before


def a_newer_journal_is_refused() -> None:
    with folder() as place:
        kept(place / "a")
        with closing(sqlite3.connect(place / "a")) as connection:
            connection.execute(f"PRAGMA user_version = {VERSION + 1}")
        try:
            read_journal(place / "a")
        except RecordError as refusal:
            sentence = str(refusal)
        else:
            raise AssertionError("a journal of a newer version is read")
        assert "written by a newer markerseek" in sentence


def a_deleted_journal_is_noticed() -> None:
    with folder() as place, new(place / "a") as journal:
        (place / "a").unlink()
        try:
            journal.commit(events(1)[0], clock_s=0.0)
        except RecordError:
            return
        raise AssertionError("an event is committed to a file that is gone")
