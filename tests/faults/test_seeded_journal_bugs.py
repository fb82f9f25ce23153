"""Bugs that somebody might write into the journal, each caught by its check; see `seeded_bugs`."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import Asked, Event, Interval, Measured, Reading, RecordError, Sample, Started
from markerseek.records.journal import Journal, read_journal
from markerseek.rigs.journalled import configuration_of, journalled
from markerseek.search import build
from seeding import Bug, caught


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
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    return Journal.create(
        path,
        configuration_of(
            rig,
            method="ternary",
            acquisitions=6,
            as_published=False,
            start_deg=0.0,
            dark_frames=0,
            stay=False,
            seed=1,
        ),
    )


def events(acquisitions: int) -> list[Event]:
    told: list[Event] = [Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0))]
    for index in range(1, acquisitions + 1):
        sample = Sample(angle_deg=0.0, reading=Reading(intensity=float(index)))
        told.append(Asked(role="search", index=index, angle_deg=0.0))
        told.append(Measured(role="search", index=index, sample=sample))
    return told


def what_is_handed_out_is_on_the_disk() -> None:
    """Each event that a run hands out can be read from a copy of the files as they are then."""
    with folder() as place:
        rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
        policy = build("ternary", limits=rig.limits.search, start_deg=0.0, acquisitions=6)
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
    """Entries in a copy of the journal and its log, as after a sudden death."""
    for name in ("a", "a-wal"):
        shutil.copyfile(place / name, place / name.replace("a", "b", 1))
    return list(read_journal(place / "b").entries)


def unreadable_after(*statements: str) -> bool:
    """Whether a journal is refused once somebody has changed it so."""
    with folder() as place:
        kept(place / "a")
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
    assert unreadable_after("UPDATE events SET samples = x'00' WHERE number = 3")


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


JOURNAL_BUGS = {
    "an event handed out before it is kept": Bug(
        where="rigs.journalled:journalled",
        old="keep(event, rig.scanner.clock, rig, journal)\n            yield event",
        new="yield event\n            keep(event, rig.scanner.clock, rig, journal)",
        check=what_is_handed_out_is_on_the_disk,
    ),
    "a transaction that is not committed": Bug(
        where="records.journal.tables:transact",
        old='connection.execute("COMMIT")',
        new='connection.execute("COMMIT" if "events" not in statements[0][0] else "ROLLBACK")',
        check=a_commit_is_on_the_disk,
    ),
    "a row's checksum not looked at": Bug(
        where="records.journal.reader:_checked_row",
        old="row_checksum(previous, row, samples) != row.checksum",
        new="False",
        check=a_changed_row_is_refused,
    ),
    "samples outside the checksum": Bug(
        where="records.journal.reader:_checked_row",
        old="row_checksum(previous, row, samples) != row.checksum",
        new="row_checksum(previous, row, None) != row.checksum",
        check=changed_samples_are_refused,
    ),
    "the configuration's checksum not looked at": Bug(
        where="records.journal.reader:read_configuration",
        old="checksum(0, row[0].encode()) != row[1]",
        new="False",
        check=a_changed_configuration_is_refused,
    ),
    "a row skipped on reading": Bug(
        where="records.journal.reader:iterate",
        old="yield entry, row.checksum",
        new="if number != 2:\n            yield entry, row.checksum",
        check=every_row_is_read,
    ),
    "a journal written over": Bug(
        where="records.journal.writer:Journal.create",
        old='path.open("xb").close()',
        new='path.open("wb").close()',
        check=a_journal_is_not_written_over,
    ),
}


@pytest.mark.parametrize("name", JOURNAL_BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    assert caught(JOURNAL_BUGS[name])


@pytest.mark.parametrize(
    "check", dict.fromkeys(bug.check for bug in JOURNAL_BUGS.values()), ids=lambda check: check.__name__
)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()
