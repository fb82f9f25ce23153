"""Durability of a commit under signals, concurrent writers and power loss."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from markerseek.core import Asked, Started
from markerseek.records.journal import (
    Interrupted,
    Journal,
    default_journal,
    line_file,
    make_folder,
    read_journal,
    salvage,
)
from tests.unit.records.journal.synthetic_journals import RANGE, configuration


@contextmanager
def struck(monkeypatch: pytest.MonkeyPatch, *, behind: str) -> Iterator[None]:
    """A signal that strikes in the middle of the next write, behind it, or behind the flush."""
    write = line_file._write

    def cut(descriptor: int, data: bytes, *, at: int) -> None:
        write(descriptor, data[: len(data) // 2] if behind == "half" else data, at=at)
        if behind != "flush":
            raise KeyboardInterrupt

    def flush(_descriptor: int) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(line_file, "_write", cut)
        patched.setattr(line_file, "flush", flush)
        with pytest.raises(KeyboardInterrupt):
            yield


@pytest.mark.parametrize("behind", ["half", "write", "flush"])
def test_a_signal_at_any_moment_of_a_commit_leaves_a_journal_that_can_be_noted_in(
    behind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    asked = Asked(role="search", index=1, angle_deg=1.1)
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.5)
        with struck(monkeypatch, behind=behind):
            journal.commit(asked, clock_s=1.5)
        assert isinstance(journal.last, Started if behind == "half" else Asked)
        journal.interrupt("SIGINT")
    entries = read_journal(path).entries
    kept = [] if behind == "half" else [asked]
    assert [entry.event for entry in entries[1:]] == [*kept, Interrupted(reason="SIGINT")]
    assert entries[-1].clock_s == (1.5 if kept else 0.5)
    assert salvage(path)[1] is None


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders whose names were put on the disk."""
    seen: list[Path] = []
    flush = os.fsync

    def synced(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            seen.append(Path(f"/proc/self/fd/{descriptor}").readlink())
        flush(descriptor)

    monkeypatch.setattr(os, "fsync", synced)
    return seen


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc which folder a descriptor is")
def test_the_names_of_new_folders_and_of_the_file_are_on_the_disk(
    flushed: list[Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home" / "share"))
    path = default_journal(method="ternary")
    make_folder(path.parent)
    Journal.create(path, configuration()).close()
    made = [tmp_path, tmp_path / "home", tmp_path / "home" / "share", tmp_path / "home" / "share" / "markerseek"]
    assert flushed == [*made, path.parent]
    flushed.clear()
    make_folder(path.parent)
    assert flushed == []
