"""Properties of a journal, as checks that detect the bugs of `test_seeded_journal_bugs`."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from unittest import mock

from markerseek import rigs
from markerseek.core import Asked, Event, Interval, Measured, PolicyPlan, Reading, RecordError, Sample, Started
from markerseek.records.journal import Journal, lines, read_journal
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
    """Entries in a copy of the journal, as after a sudden death."""
    shutil.copyfile(place / "a", place / "b")
    return list(read_journal(place / "b").entries)


def flipped_at(find: Callable[[bytes], int]) -> bytes:
    """What is said of a journal, of which the last event has a frame, after a flipped bit."""
    with folder() as place:
        with new(place / "a") as journal:
            for event in (*events(2), measured(3, channels=2)):
                journal.commit(event, clock_s=0.0)
        data = bytearray((place / "a").read_bytes())
        data[find(bytes(data))] ^= 1
        (place / "a").write_bytes(data)
        try:
            read_journal(place / "a")
        except RecordError as refusal:
            return str(refusal).encode()
        return b""


def a_changed_line_is_refused() -> None:
    assert flipped_at(lambda data: data.index(b'"clock_s":0', data.index(b'"number":       3')) + 10)


def changed_samples_are_refused() -> None:
    assert flipped_at(lambda data: len(data) - 100)


def a_changed_configuration_is_refused() -> None:
    assert flipped_at(lambda data: data.index(b"ternary"))


def a_changed_length_is_damage_and_no_torn_end() -> None:
    """The last entry seems longer than the file."""
    assert flipped_at(lambda data: data.rindex(b'"frame_bytes":') + len(b'"frame_bytes":') + 6)


def entries_of_another_run_are_refused() -> None:
    with folder() as place:
        kept(place / "a")
        kept(place / "b", acquisitions=4)
        one, other = ((place / name).read_bytes() for name in "ab")
        at = one.index(b'{"number":       3')
        (place / "a").write_bytes(one[:at] + other[other.index(b'{"number":       3') :])
        assert read_whole(place / "a") == -1


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


def a_torn_end_is_cut_off() -> None:
    with folder() as place:
        died_in_commit(place / "a", lambda journal: [journal.commit(each, clock_s=0.0) for each in events(2)])
        journal, held = Journal.reopen(place / "a")
        with journal:
            journal.interrupt("made up")
        assert len(held.entries) == len(events(2))
        assert read_whole(place / "a") == len(events(2)) + 1


def a_newer_journal_is_refused() -> None:
    with folder() as place:
        line, _ = lines.first_line(configuration())
        held = line[lines.PREFIX_BYTES :].replace(b'"journal":1,', b'"journal":2,').rstrip()
        (place / "a").write_bytes(lines._chained(0, b"{" + held, b"", previous=0)[0])
        try:
            read_journal(place / "a")
        except RecordError as refusal:
            sentence = str(refusal)
        else:
            raise AssertionError("a journal of a newer version is read")
        assert "written by a newer markerseek" in sentence


def a_second_writer_is_refused() -> None:
    with folder() as place, new(place / "a") as journal:
        try:
            Journal.reopen(place / "a")
        except RecordError:
            journal.commit(events(1)[0], clock_s=0.0)
            return
        raise AssertionError("two programs drive one run")


def a_deleted_journal_is_noticed() -> None:
    with folder() as place, new(place / "a") as journal:
        (place / "a").unlink()
        try:
            journal.commit(events(1)[0], clock_s=0.0)
        except RecordError:
            return
        raise AssertionError("an event is committed to a file that is gone")
