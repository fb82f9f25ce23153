"""The file of a journal: where it can be created, what is not one, and who may open it."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from markerseek.core import Asked, RecordError, Started
from markerseek.records.banks import read_bank
from markerseek.records.journal import Journal, read_journal, salvage
from markerseek.runs import journal_summary
from tests.unit.records.journal.synthetic_journals import RANGE, configuration


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


def checked(rest: bytes) -> bytes:
    """A line 0 with a checksum that agrees, as a foreign program may write it."""
    return b'{"crc":"%08x",' % zlib.crc32(rest) + rest


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda path: path.write_bytes(b""), "no journal of a run"),
        (lambda path: path.write_bytes(b"not a database, and as long as one" * 99), "another kind of file"),
        (
            lambda path: path.write_bytes(b'{"number":       0,"bytes":' + b" 1" * 99),
            "it does not begin as an entry does",
        ),
        (lambda path: path.write_bytes(checked(b'"block":99999999999}\n')), "has a frame of 99999999999 bytes"),
        (lambda path: path.write_bytes(checked(b'"record":2,"configuration":{}}\n')), "cannot be read"),
        (lambda path: path.write_bytes(checked(b'"record":2,"configuration":' + b"[" * 9999 + b"}\n")), "cannot be"),
        (lambda path: path.write_bytes(checked(b'"record":2,"record":-9e99,"configuration":0}\n')), "cannot be read"),
        (lambda path: path.mkdir(), "it is a folder, and a journal is one file"),
        (os.mkfifo, "it is not a regular file"),
        (lambda _: None, "no such journal"),
    ],
    ids=["empty", "text", "lengths", "huge", "other", "deep", "twice", "folder", "pipe", "missing"],
)
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
    with pytest.raises(RecordError, match=f"{name}: it is the journal of a run.*'markerseek journal replay .*{name}'"):
        read_bank(path)
