"""Journals in a folder: default names, summaries for lists, and the removal of old ones."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from markerseek.core import ConfigError, Finished, RecordError
from markerseek.files import sync_folder
from markerseek.records.journal.encoding import escaped
from markerseek.records.journal.file import as_record_error, journals_folder, lock, open_for_reading
from markerseek.records.journal.lines import EntryReader
from markerseek.records.journal.reader import salvage
from markerseek.records.journal.sequence import run_state
from markerseek.records.result import answer_name

SUFFIX = ".journal"
"""Suffix of the files that `journals_in` finds, and of default names."""


def default_journal(*, method: str) -> Path:
    """Name of a new journal in the user's data folder; its name begins with the time, UTC."""
    # With microseconds, so that two searches begun in one second get two names.
    now = datetime.now(UTC)
    return journals_folder() / f"{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}-{method}{SUFFIX}"


def make_folder(folder: Path) -> None:
    """Make a folder and its missing parents, readable by the owner only, and flush their names to disk.

    ``folder``: one that may exist. Raises `OSError` if it cannot be made.
    """
    # Path.mkdir(parents=True) gives the parents default rights, and does not flush their names.
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)
        sync_folder(each.parent)


class JournalSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a list of journals; values that cannot be read are None."""

    path: str
    """The file; bytes of its name that are not Unicode are written as escapes."""
    size_bytes: int
    begun: str | None = None
    """When its run began, UTC, ISO 8601."""
    method: str | None = None
    as_published: bool | None = None
    rig: str | None = None
    emulated: tuple[str, ...] = ()
    """``method``, ``as_published``, ``rig`` and ``emulated``: the policy's name and whether it is in the paper's form,
    the kind of the rig, and its emulated devices."""
    description: str | None = None
    """The rig in words; of a simulated one also tissue and seed."""
    seed: int | None = None
    """Seed of a simulated rig."""
    state: Literal["finished", "fault", "open", "running", "damaged", "unreadable"]
    """"running" while a program writes it, "damaged" if only a part can be read, "unreadable" if nothing can."""
    answer: str | None = None
    angle_deg: float | None = None
    """``answer`` and ``angle_deg``: the answer of a run that is over, and the angle in degrees to which it points."""
    acquisitions: int | None = None
    """Acquisitions with light that the search received."""
    problem: str | None = None
    """What is wrong, in words."""


def summary(path: Path) -> JournalSummary:
    """Summary of a journal; damage is reported in it, not raised."""
    size_bytes = size_bytes_of(path)
    name = escaped(str(path))
    try:
        recorded, damage = salvage(path, frames=False)
    except RecordError as problem:
        # One unreadable file must not hide the others of the list.
        return JournalSummary(path=name, size_bytes=size_bytes, state="unreadable", problem=_without(path, problem))
    state = run_state(recorded.entries)
    last = recorded.entries[-1].event if recorded.entries else None
    over = last if isinstance(last, Finished) else None
    return JournalSummary(
        path=name,
        size_bytes=size_bytes,
        begun=recorded.entries[0].written if recorded.entries else None,
        method=recorded.configuration.plan.method,
        as_published=recorded.configuration.plan.as_published,
        rig=recorded.configuration.facts.kind,
        emulated=recorded.configuration.facts.emulated,
        description=recorded.configuration.facts.description,
        seed=recorded.configuration.facts.seed,
        state="damaged" if damage is not None else "running" if recorded.is_written else state.state,
        answer=None if over is None else answer_name(over.estimate),
        angle_deg=None if over is None else over.estimate.mean_deg,
        acquisitions=state.acquisitions,
        problem=state.fault if damage is None else _without(path, damage),
    )


def _without(path: Path, problem: RecordError) -> str:
    # The list prints the path once, so that the message need not begin with it.
    return escaped(str(problem).removeprefix(f"{path}: "))


def journals_in(folder: Path) -> list[Path]:
    """Journals of a folder, the newest change last.

    ``folder``: where to look; not in the folders that it holds.
    """
    try:
        found = [
            (each.stat().st_mtime_ns, each)
            for each in folder.iterdir()
            if each.suffix == SUFFIX and each.is_file() and not each.name.startswith(".")
        ]
    except OSError as problem:
        raise RecordError(f"{folder}: no journals can be listed: {problem.strerror or problem}; check it") from problem
    return [path for _, path in sorted(found)]


def size_bytes_of(path: Path) -> int:
    """Bytes of a journal; a missing file counts 0."""
    with suppress(OSError):
        return path.stat().st_size
    return 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Prunable:
    """Journals that may go, and those that stay although they are old."""

    old: tuple[JournalSummary, ...]
    """Journals that may go, the oldest first."""
    kept: tuple[JournalSummary, ...]
    """Summaries of old journals that stay: their run is not over, or they cannot be read."""


def prunable(
    folder: Path,
    *,
    now_s: float,
    keep: int | None = None,
    older_than_s: float | None = None,
    unfinished: bool = False,
) -> Prunable:
    """Journals of a folder that are neither among the newest nor young.

    ``folder``: not the folders in it. Symbolic links in it are left alone. ``now_s``: present time, in seconds since
    1970. ``keep``: number of the newest journals that stay; None for no such rule. ``older_than_s``: least time since
    the last change; None for no such rule. ``unfinished``: whether journals go whose run was interrupted or ended with
    a fault, and could be resumed.
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
    """Remove a journal.

    Raises `RecordError` if a program writes it, it is no journal, or it cannot be removed.
    """
    with as_record_error(path, verb="removed"):
        if path.is_symlink():
            raise RecordError(f"{path}: it is a symbolic link; remove it by hand")
        descriptor = open_for_reading(path)
        try:
            # Fails while a run holds it, and keeps a `resume` out until the file is gone.
            lock(descriptor)
            EntryReader(path, descriptor)
            path.unlink()
        finally:
            os.close(descriptor)
