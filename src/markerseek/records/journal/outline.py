"""A journal in a few words, for lists of many."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from markerseek.core import Finished, RecordError
from markerseek.records.journal.grammar import standing
from markerseek.records.journal.plain import readable
from markerseek.records.journal.reader import salvage
from markerseek.records.journal.store import followed, log_of
from markerseek.records.result import answer_name

SUFFIX = ".journal"
"""Of files that `outlines` looks at, and of those that nobody named."""


class Outline(msgspec.Struct, frozen=True, kw_only=True):
    """What a list says of a journal; None where it cannot be read.

    Attributes
    ----------
    path
        The file; whatever is no Unicode in its name is written as escapes.
    size_bytes
        Its size with that of its log.
    begun
        When its run began, UTC, ISO 8601.
    method, rig
        The policy's name, and the kind of the rig.
    state
        As in `Standing`; or that the file cannot be read, or only in part, or not now.
    answer, angle_deg
        The answer of a run that is over, and the angle in degrees to which it points.
    acquisitions
        Acquisitions with light that a search was told of.
    problem
        What is wrong, in words.
    """

    path: str
    size_bytes: int
    begun: str | None = None
    method: str | None = None
    rig: str | None = None
    state: Literal["finished", "fault", "open", "damaged", "unreadable"]
    answer: str | None = None
    angle_deg: float | None = None
    acquisitions: int | None = None
    problem: str | None = None


def outline(path: Path) -> Outline:
    """A journal in a few words, whatever is wrong with it.

    Parameters
    ----------
    path
        The file.
    """
    size_bytes = size_with_log(path)
    name = readable(str(path))
    try:
        held, damage = salvage(path, frames=False)
    except RecordError as problem:
        return Outline(path=name, size_bytes=size_bytes, state="unreadable", problem=_without(path, problem))
    stands = standing(held.entries)
    last = held.entries[-1].event if held.entries else None
    over = last if isinstance(last, Finished) else None
    return Outline(
        path=name,
        size_bytes=size_bytes,
        begun=held.entries[0].written if held.entries else None,
        method=held.configuration.plan.method,
        rig=held.configuration.facts.kind,
        state=stands.state if damage is None else "damaged",
        answer=None if over is None else answer_name(over.estimate),
        angle_deg=None if over is None else over.estimate.mean_deg,
        acquisitions=stands.acquisitions,
        problem=stands.fault if damage is None else _without(path, damage),
    )


def _without(path: Path, problem: RecordError) -> str:
    return readable(str(problem).removeprefix(f"{followed(path)}: "))


def journals_in(folder: Path) -> list[Path]:
    """Journals of a folder, the newest change last.

    Parameters
    ----------
    folder
        Where to look; not in the folders that it holds.

    Raises
    ------
    RecordError
        If there is no such folder, or it cannot be looked at.
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


def size_with_log(path: Path) -> int:
    """Bytes of a journal and of the log beside it; what is not there counts nothing."""
    path = followed(path)
    return sum(part.stat().st_size for part in (path, log_of(path)) if part.is_file())
