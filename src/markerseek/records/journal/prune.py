"""Selects old journals of runs that are over, and removes journals that no program has open."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from markerseek.core import ConfigError, RecordError
from markerseek.records.journal.connection import as_record_error, connect, require_journal_file, rollback_file
from markerseek.records.journal.summary import JournalSummary, journals_in, summary


@dataclass(frozen=True, slots=True, kw_only=True)
class Prunable:
    """Journals that may go, and those that stay although they are old.

    Attributes
    ----------
    old
        Journals that may go, the oldest first.
    kept
        Summaries of old journals that stay: their run is not over, or they cannot be read, for example because the run
        is going on.
    """

    old: tuple[JournalSummary, ...]
    kept: tuple[JournalSummary, ...]


def prunable(
    folder: Path,
    *,
    now_s: float,
    keep: int | None = None,
    older_than_s: float | None = None,
    unfinished: bool = False,
) -> Prunable:
    """Journals of a folder that are neither among the newest nor young.

    Parameters
    ----------
    folder
        The folder; not the folders in it. Symbolic links in it are left alone.
    now_s
        Present time, in seconds since 1970.
    keep
        Number of the newest journals that stay; None for no such rule.
    older_than_s
        Least time since the last change, in seconds; None for no such rule.
    unfinished
        Whether journals go whose run was interrupted or ended with a fault, and could be resumed.

    Raises
    ------
    ConfigError
        If no rule is given, or one is negative.
    RecordError
        If the folder cannot be looked at.
    """
    if keep is None and older_than_s is None:
        raise ConfigError("prune: say which journals go: --keep NUMBER, --older-than-days DAYS, or both")
    if not (keep is None or keep >= 0) or not (older_than_s is None or older_than_s >= 0):
        raise ConfigError(f"prune: keep is {keep}, older_than_s is {older_than_s} s; both must be 0 or more")
    paths = journals_in(folder)
    paths = paths[: max(0, len(paths) - (keep or 0))]
    if older_than_s is not None:
        paths = [path for path in paths if now_s - path.stat().st_mtime > older_than_s]
    over = ("finished", "fault", "open") if unfinished else ("finished",)
    found = [summary(path) for path in paths if not path.is_symlink()]
    return Prunable(
        old=tuple(each for each in found if each.state in over),
        kept=tuple(each for each in found if each.state not in over),
    )


def remove_journal(path: Path) -> None:
    """Remove a journal with its rollback file.

    Raises
    ------
    RecordError
        If a program has it open, it is no journal, or it cannot be removed.
    """
    with as_record_error(path, verb="removed"):
        if path.is_symlink():
            raise RecordError(f"{path}: it is a symbolic link; remove it by hand")
        require_journal_file(path)
        with closing(connect(path, mode="rw")) as connection:
            # Fails while a run holds its lock, and keeps a `resume` out until the file is gone.
            connection.execute("BEGIN EXCLUSIVE")
            path.unlink()
            rollback_file(path).unlink(missing_ok=True)
