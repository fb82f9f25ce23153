"""The journal's readers as functions of bytes, for fuzzing: of the file, and of the log beside a sound one."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from markerseek.records.journal.store import log_of

from journal_runs import configuration, measured
from markerseek.core import Asked, Interval, Started
from markerseek.records.journal import Journal, salvage, verify


@lru_cache
def whole(part: str) -> bytes:
    """A closed journal of a few entries; or, of one that died, the ``file`` or its ``log``."""
    with tempfile.TemporaryDirectory() as name:
        path, copy = Path(name) / "run.journal", Path(name) / "copy.journal"
        with Journal.create(path, configuration()) as journal:
            journal.commit(Started(start_deg=0.0, limits=Interval(low_deg=-35.0, high_deg=35.0)), clock_s=0.0)
            for index in (1, 2):
                journal.commit(Asked(role="search", index=index, angle_deg=0.0), clock_s=0.0)
                journal.commit(measured(index, channels=2), clock_s=0.0)
            for one, other in ((path, copy), (log_of(path), log_of(copy))):
                shutil.copyfile(one, other)
        return {"closed": path, "file": copy, "log": log_of(copy)}[part].read_bytes()


def read_file(path: Path) -> None:
    """All that is done with a journal that somebody sends."""
    log_of(path).unlink(missing_ok=True)
    _read(path)


def read_log(log: Path) -> None:
    """The same, where what may be damaged is the log."""
    path = Path(str(log).removesuffix("-wal"))
    path.write_bytes(whole("file"))
    _read(path)


def _read(path: Path) -> None:
    salvage(path)
    verify(path)
    journal, _ = Journal.reopen(path)
    with journal:
        journal.interrupt("made up")


JOURNALS: dict[str, tuple[str, Callable[[], bytes], Callable[[Path], object]]] = {
    "journal": ("a.journal", lambda: whole("closed"), read_file),
    "journal-log": ("a.journal-wal", lambda: whole("log"), read_log),
}
"""As `decoders.DECODERS`."""
