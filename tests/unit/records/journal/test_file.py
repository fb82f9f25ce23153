"""The file of a journal: where it can be created, what is not one, who may open it; lost, moved and replaced ones."""

from __future__ import annotations

import os
import shutil
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import Asked, RecordError, Started
from markerseek.guard import State
from markerseek.records.banks import read_bank
from markerseek.records.journal import Journal, read_journal, salvage
from markerseek.records.journal.lines import first_line
from markerseek.runs import journal_summary
from markerseek.runs.journalled import journalled
from tests.unit.records.journal.synthetic_journals import RANGE, configuration, write
from tests.unit.runs.journalled_runs import begin, times_and_events


def test_two_programs_do_not_drive_one_run_and_any_number_read_it(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        before = path.read_bytes()
        with pytest.raises(RecordError, match="another markerseek writes this journal; wait until that is over"):
            Journal.reopen(path)
        assert path.read_bytes() == before
        assert len(read_journal(path).entries) == 1
        assert salvage(path)[1] is None
        assert journal_summary(path).state == "running"
        journal.commit(Asked(role="search", index=1, angle_deg=1.1), clock_s=0.0)
    assert len(read_journal(path).entries) == 2
    assert journal_summary(path).state == "open"


def holding(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)


def begun(rest: bytes) -> Callable[[Path], object]:
    """A file with a line 0 whose checksum agrees, as a foreign program may write it."""
    return holding(line_with(rest))


def line_with(rest: bytes) -> bytes:
    return b'{"crc":"%08x",' % zlib.crc32(rest) + rest


NO_JOURNALS: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty": (holding(b""), "no journal of a run"),
    "text": (holding(b"not a database, and as long as one" * 99), "another kind of file"),
    "lengths": (holding(b'{"number":       0,"bytes":' + b" 1" * 99), "it does not begin as an entry does"),
    "huge": (
        holding(first_line(configuration()) + line_with(b'"number":1,"block":99999999999}\n')),
        "entry 1 has a frame of 99999999999 bytes",
    ),
    "other": (begun(b'"record":2,"configuration":{}}\n'), "cannot be read"),
    "number": (begun(b'"record":2,"configuration":0}\n'), "cannot be read"),
    "tolerance": (begun(b'"record":2,"configuration":{"plan":{"tolerance":3}}}\n'), "cannot be read"),
    "deep": (begun(b'"record":2,"configuration":' + b"[" * 9999 + b"}\n"), "cannot be read"),
    "twice": (begun(b'"record":2,"record":-9e99,"configuration":0}\n'), "cannot be read"),
    "folder": (lambda path: path.mkdir(), "it is a folder, and a journal is one file"),
    "pipe": (os.mkfifo, "it is not a regular file"),
    "missing": (lambda _: None, "no such journal"),
}


@pytest.mark.parametrize(("make", "said"), NO_JOURNALS.values(), ids=NO_JOURNALS)
def test_a_file_that_is_not_a_journal_is_reported(make: Callable[[Path], object], said: str, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    make(path)
    for look in (read_journal, Journal.reopen):
        with pytest.raises(RecordError, match=said) as refused:
            look(path)
        assert str(refused.value).startswith(f"{path}: ")


def a_file(path: Path) -> Path:
    path.write_bytes(b"mine")
    return path


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (lambda folder: folder, "it is a folder, and a journal is one file; name a new file in it"),
        (lambda folder: folder / "none" / "a.journal", "No such file or directory; check the folder, the rights"),
        (lambda folder: a_file(folder / "file") / "a.journal", "Not a directory; check the folder, the rights"),
        (lambda folder: a_file(folder / "a.journal"), "exists already and is no journal; name a new file"),
        (lambda folder: folder / ("a" * 300), "File name too long; check the folder"),
        pytest.param(
            lambda _: Path("/sys/a.journal"),
            "check the folder, the rights",
            marks=pytest.mark.skipif(not Path("/sys/kernel").exists(), reason="needs a folder for nobody"),
        ),
    ],
    ids=["folder", "no parent", "parent is a file", "another file", "long name", "no right"],
)
def test_where_no_journal_can_be_begun_the_remedy_is_given(
    place: Callable[[Path], Path], said: str, tmp_path: Path
) -> None:
    path = place(tmp_path)
    with pytest.raises(RecordError, match=said) as refused:
        Journal.create(path, configuration())
    assert str(refused.value).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["run.journal", "run.csv", "run.hdf5"])
def test_a_journal_given_as_a_bank_is_reported_as_a_journal(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    Journal.create(path, configuration()).close()
    with pytest.raises(RecordError, match=f"{name}: it is the journal of a run.*`answer_again\\(.*{name}"):
        read_bank(path)


def removed(path: Path) -> None:
    path.unlink()


def replaced(path: Path) -> None:
    copy = shutil.copy(path, path.with_name("copy"))
    Path(copy).replace(path)


def folder_removed(path: Path) -> None:
    shutil.rmtree(path.parent)


def cut_to(more: int | None) -> Callable[[Path], None]:
    """A file that another program makes so many bytes longer, or empty."""
    return lambda path: os.truncate(path, 0 if more is None else path.stat().st_size + more)


@pytest.mark.parametrize("harm", [removed, replaced, folder_removed, *map(cut_to, (-1, -100, None, 1))])
def test_a_journal_that_is_lost_or_changed_in_mid_run_stops_it(harm: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "runs" / "run.journal"
    path.parent.mkdir()
    policy, rig, configured = begin()
    journal = Journal.create(path, configured)
    events = journalled(policy, rig, journal)
    for _ in range(9):
        next(events)
    harm(path)
    with pytest.raises(RecordError, match="changed, removed or replaced while the run was written"):
        next(events)
    assert rig.scanner.guard.state not in {State.FIRING, State.MOVING}
    journal.close()


def test_a_journal_that_is_lost_after_the_last_commit_is_noticed_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    journal = Journal.create(path, configuration())
    write(journal, 2)
    removed(path)
    with pytest.raises(RecordError, match="it was changed, removed or replaced while the run was written"):
        journal.close()
    journal.close()


def test_a_journal_that_is_moved_in_mid_run_goes_on_in_its_new_place(tmp_path: Path, whole: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configured = begin()
    with Journal.create(path, configured) as journal:
        events = journalled(policy, rig, journal)
        for _ in range(9):
            next(events)
        path.rename(tmp_path / "elsewhere")
        list(events)
    assert times_and_events(read_journal(tmp_path / "elsewhere")) == times_and_events(read_journal(whole))
