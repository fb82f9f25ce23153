"""The journal's readers as functions of bytes, for fuzzing: the file and its rollback journal."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from markerseek.core import Asked, Interval, Started
from markerseek.records.journal import Journal, salvage, verify
from markerseek.records.journal.connection import rollback_file
from tests.faults.journal_runs import configuration, died_in_commit, measured


@lru_cache
def whole() -> dict[str, bytes]:
    """A ``closed`` journal of a few entries; the ``file`` and the ``rollback`` of one whose run died in a commit."""
    with tempfile.TemporaryDirectory() as name:
        closed, dead = Path(name) / "run.journal", Path(name) / "dead.journal"
        with Journal.create(closed, configuration()) as journal:
            _write(journal)
        died_in_commit(dead, _write)
        parts = {"closed": closed, "file": dead, "rollback": rollback_file(dead)}
        return {part: path.read_bytes() for part, path in parts.items()}


def _write(journal: Journal) -> None:
    journal.commit(Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0)), clock_s=0.0)
    for index in (1, 2):
        journal.commit(Asked(role="search", index=index, angle_deg=0.0), clock_s=0.0)
        journal.commit(measured(index, channels=2), clock_s=0.0)


def read_file(path: Path) -> None:
    """Every operation on a foreign journal."""
    rollback_file(path).unlink(missing_ok=True)
    _read(path)


def read_rollback(rollback: Path) -> None:
    """The same, where what may be damaged is the rollback journal."""
    path = Path(str(rollback).removesuffix("-journal"))
    path.write_bytes(whole()["file"])
    _read(path)


def _read(path: Path) -> None:
    salvage(path)
    verify(path)
    journal, _ = Journal.reopen(path)
    with journal:
        journal.interrupt("made up")


JOURNALS: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], object]]] = {
    "journal": ("a.journal", lambda: whole()["closed"], read_file),
    "journal-rollback": ("a.journal-journal", lambda: whole()["rollback"], read_rollback),
}
"""As `decoders.DECODERS`."""
