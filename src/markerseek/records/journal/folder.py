"""Journals in a folder: default names, and summaries for lists."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import msgspec

from markerseek.core import Finished, RecordError
from markerseek.files import sync_folder
from markerseek.records.journal.encoding import escaped
from markerseek.records.journal.file import journals_folder
from markerseek.records.journal.reader import run_state, salvage
from markerseek.records.words import answer_line, answer_name

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

    @property
    def end(self) -> str:
        """The answer with its angle, in a line; the state of a run without an answer."""
        if self.answer is None or self.angle_deg is None:
            return self.state
        return answer_line(self.answer, self.angle_deg, as_published=bool(self.as_published))


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
