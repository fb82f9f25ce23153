"""The journal's readers as functions of bytes, for fuzzing."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from markerseek.core import Asked, Interval, Started
from markerseek.records.journal import Journal, follow, salvage, verify
from tests.faults.journal_runs import configuration, died_in_commit, measured


@lru_cache
def whole() -> dict[str, bytes]:
    """A ``closed`` journal of a few entries, and a ``torn`` one whose run died in a commit."""
    with tempfile.TemporaryDirectory() as name:
        closed, torn = Path(name) / "run.journal", Path(name) / "torn.journal"
        with Journal.create(closed, configuration()) as journal:
            _write(journal)
        died_in_commit(torn, _write)
        return {"closed": closed.read_bytes(), "torn": torn.read_bytes()}


def _write(journal: Journal) -> None:
    journal.commit(Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0)), clock_s=0.0)
    for index in (1, 2):
        journal.commit(Asked(role="search", index=index, angle_deg=0.0), clock_s=0.0)
        journal.commit(measured(index, channels=2), clock_s=0.0)


def read_file(path: Path) -> None:
    """Every operation on a foreign journal."""
    salvage(path)
    verify(path)
    for _ in follow(path, wait=lambda: None):
        pass
    journal, _ = Journal.reopen(path)
    with journal:
        journal.interrupt("made up")


JOURNALS: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], object]]] = {
    "journal": ("a.journal", lambda: whole()["closed"], read_file),
    "journal-torn": ("a.journal", lambda: whole()["torn"], read_file),
}
"""As `decoders.DECODERS`."""
