"""A rollback file beside a foreign journal may name a "super-journal", which SQLite deletes: here a file of ours."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.records.journal import Journal

MAGIC = bytes.fromhex("d9d505f920a163d7")
PAGE_BYTES, SECTOR_BYTES = 4096, 512
Shell = Callable[..., tuple[int, str, str]]


def name_super_journal(journal: Path, victim: Path) -> None:
    """Put a rollback file beside a journal, which undoes nothing and names a super-journal."""
    pages = journal.stat().st_size // PAGE_BYTES
    header = MAGIC + struct.pack(">5I", 0, 1, pages, SECTOR_BYTES, PAGE_BYTES)
    name = os.fsencode(victim)
    record = struct.pack(">I", (1 << 30) // PAGE_BYTES + 1) + name + struct.pack(">2I", len(name), sum(name)) + MAGIC
    Path(f"{journal}-journal").write_bytes(header.ljust(SECTOR_BYTES, b"\0") + record)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of a search."""
    from markerseek import runs
    from markerseek.core import SearchPlan
    from markerseek.rigs import simulated

    path = tmp_path_factory.mktemp("run") / "run.journal"
    rig = simulated(seed=1)
    session = runs.new_session(rig, SearchPlan(method="weighted-average", acquisitions=4))
    with Journal.create(path, session.configuration) as journal:
        for _ in replace(session, journal=journal).events():
            pass
    return path


@pytest.fixture
def hostile(finished: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A foreign journal, and the file that its rollback file is after."""
    folder, victim = tmp_path / "foreign", tmp_path / "thesis.tex"
    folder.mkdir()
    victim.write_text("four years\n")
    journal = folder / "run.journal"
    shutil.copyfile(finished, journal)
    name_super_journal(journal, victim)
    return journal, victim


def files(folder: Path) -> dict[str, bytes]:
    return {each.name: each.read_bytes() for each in folder.iterdir()}


def test_sqlite_itself_deletes_the_named_file(hostile: tuple[Path, Path]) -> None:
    """Else the other tests would prove nothing."""
    journal, victim = hostile
    with closing(sqlite3.connect(journal)) as connection:
        connection.execute("SELECT * FROM run").fetchall()
    assert not victim.exists()


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("journal", "verify", "JOURNAL"), 2),
        (("journal", "show", "JOURNAL"), 2),
        (("journal", "list", "FOLDER"), 0),
        (("journal", "replay", "JOURNAL"), 2),
        (("journal", "prune", "FOLDER", "--keep", "0", "--unfinished", "--delete"), 0),
        (("resume", "JOURNAL", "--arm"), 2),
        (("search", "--prior", "JOURNAL", "--no-journal"), 2),
        (("bank", "import", "JOURNAL", "OUT"), 2),
        (("igtl", "--port", "0", "--play", "JOURNAL"), 2),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, tuple) else None,
)
def test_reading_a_foreign_journal_deletes_and_writes_nothing(
    words: tuple[str, ...], code: int, hostile: tuple[Path, Path], shell: Shell, tmp_path: Path
) -> None:
    journal, victim = hostile
    before = files(journal.parent)
    named = {"JOURNAL": str(journal), "FOLDER": str(journal.parent), "OUT": str(tmp_path / "bank.h5")}
    ended, out, err = shell(*(named.get(word, word) for word in words))
    assert victim.read_text() == "four years\n"
    assert files(journal.parent) == before
    assert ended == code
    said = "1 old ones stay" if "prune" in words else "names a further file, which SQLite would delete"
    assert said in " ".join((out + err).split())


@pytest.mark.parametrize("hot", [True, False], ids=["hot", "done"])
def test_a_journal_is_not_continued_beside_such_a_file(hot: bool, hostile: tuple[Path, Path]) -> None:
    """Also where there is nothing to undo: the name would still lie there after the next commit."""
    journal, victim = hostile
    rollback = Path(f"{journal}-journal")
    if not hot:
        rollback.write_bytes(bytes(28) + rollback.read_bytes()[28:])
    before = files(journal.parent)
    with pytest.raises(RecordError, match="names a further file"):
        Journal.reopen(journal)
    assert (victim.exists(), files(journal.parent)) == (True, before)


def test_a_pipe_in_the_place_of_a_rollback_file_is_refused(finished: Path, tmp_path: Path, shell: Shell) -> None:
    shutil.copyfile(finished, tmp_path / "run.journal")
    os.mkfifo(tmp_path / "run.journal-journal")
    code, _, err = shell("journal", "verify", tmp_path / "run.journal")
    assert (code, "not a regular file" in " ".join(err.split())) == (2, True)
