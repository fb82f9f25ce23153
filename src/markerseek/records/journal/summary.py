"""Summary of a journal for lists, and the result of its run."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import msgspec

from markerseek.core import Failed, Finished, Measured, RecordError, Refused, Started
from markerseek.records.journal.connection import resolve_link, rollback_file
from markerseek.records.journal.encoding import escaped
from markerseek.records.journal.reader import RecordedRun, salvage
from markerseek.records.journal.sequence import run_state
from markerseek.records.result import Recorder, SearchResult, answer_name

SUFFIX = ".journal"
"""Suffix of the files that `journals_in` finds, and of default names."""


class JournalSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One line of a list of journals; values that cannot be read are None.

    Attributes
    ----------
    path
        The file; bytes of its name that are not Unicode are written as escapes.
    size_bytes
        Its size with that of its rollback journal.
    begun
        When its run began, UTC, ISO 8601.
    method, as_published, rig, emulated
        The policy's name and whether it is in the paper's form, the kind of the rig, and its emulated devices.
    state
        As in `RunState`; "damaged" if only a part can be read, "unreadable" if nothing can be read now.
    answer, angle_deg
        The answer of a run that is over, and the angle in degrees to which it points.
    acquisitions
        Acquisitions with light that the search received.
    problem
        What is wrong, in words.
    """

    path: str
    size_bytes: int
    begun: str | None = None
    method: str | None = None
    as_published: bool | None = None
    rig: str | None = None
    emulated: tuple[str, ...] = ()
    state: Literal["finished", "fault", "open", "damaged", "unreadable"]
    answer: str | None = None
    angle_deg: float | None = None
    acquisitions: int | None = None
    problem: str | None = None


def summary(path: Path) -> JournalSummary:
    """Summary of a journal; damage is reported in it, not raised.

    Parameters
    ----------
    path
        The file.
    """
    size_bytes = size_bytes_of(path)
    name = escaped(str(path))
    try:
        held, damage = salvage(path, frames=False)
    except RecordError as problem:
        # One unreadable file must not hide the others of the list.
        return JournalSummary(path=name, size_bytes=size_bytes, state="unreadable", problem=_without(path, problem))
    state = run_state(held.entries)
    last = held.entries[-1].event if held.entries else None
    over = last if isinstance(last, Finished) else None
    return JournalSummary(
        path=name,
        size_bytes=size_bytes,
        begun=held.entries[0].written if held.entries else None,
        method=held.configuration.plan.method,
        as_published=held.configuration.plan.as_published,
        rig=held.configuration.facts.kind,
        emulated=held.configuration.facts.emulated,
        state=state.state if damage is None else "damaged",
        answer=None if over is None else answer_name(over.estimate),
        angle_deg=None if over is None else over.estimate.mean_deg,
        acquisitions=state.acquisitions,
        problem=state.fault if damage is None else _without(path, damage),
    )


def _without(path: Path, problem: RecordError) -> str:
    # The list prints the path once, so that the message need not begin with it.
    return escaped(str(problem).removeprefix(f"{resolve_link(path)}: "))


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


def size_bytes_of(path: Path) -> int:
    """Bytes of a journal and of its rollback file; a missing file counts 0."""
    path = resolve_link(path)
    return sum(part.stat().st_size for part in (path, rollback_file(path)) if part.is_file())


def result_of(held: RecordedRun) -> tuple[Recorder, SearchResult]:
    """Result of a run that is over, and the recorder that collected it.

    Parameters
    ----------
    held
        Its journal.

    Raises
    ------
    SearchError
        If the run is not over, or ended with a fault.
    """
    recorder = Recorder()
    for entry in held.entries:
        if isinstance(entry.event, Started | Measured | Refused | Finished | Failed):
            recorder.add(entry.event)
    return recorder, recorder.result(held.configuration.plan, held.configuration.facts)
