"""The content of each search run without a kill, and the comparison of resumed searches with it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from markerseek.core import Asked, Finished, Found, Measured, RecordError, Swept
from markerseek.records.journal import (
    Checked,
    Entry,
    Interrupted,
    Journal,
    RecordedRun,
    Resuming,
    read_journal,
    result_of,
    verify,
)
from markerseek.runs.resume import resumed

from .processes import MismatchError
from .searches import MARKER_DEG, PERSON, SEARCHES, Search, arming_watched
from .tally import Row, Tally

OFF_DEG = 1.0
"""Most that a marker found may be off, in degrees."""

Happened = list[tuple[object, float, bytes]]


def own_entries(held: RecordedRun) -> list[Entry]:
    """Entries of the run itself, without those of interruptions, resumes and checks."""
    return [entry for entry in held.entries if not isinstance(entry.event, Interrupted | Resuming | Checked)]


def happened(held: RecordedRun) -> Happened:
    """What a run did, without what only a resumed one holds: event, time, and samples of the frame."""
    rows = []
    for entry in own_entries(held):
        frame = entry.event.sample.frame if isinstance(entry.event, Measured) else None
        samples = getattr(frame, "samples", np.empty(0, dtype=np.int16))
        rows.append((entry.event, entry.clock_s, samples.tobytes()))
    return rows


@cache
def folder() -> Path:
    """Where this process keeps its journals."""
    return Path(tempfile.mkdtemp(prefix="kills-"))


_numbers = iter(range(1, 1 << 62))


def new_path(suffix: str = ".journal") -> Path:
    """A path that was not used before."""
    return folder() / f"{next(_numbers)}{suffix}"


def copy_of(path: Path) -> Path:
    """A copy of a journal, with whatever a kill left beside it."""
    copied = new_path()
    for part in path.parent.glob(f"{path.name}*"):
        shutil.copyfile(part, f"{copied}{part.name.removeprefix(path.name)}")
    return copied


def remove(path: Path) -> None:
    """Remove a journal and whatever lies beside it."""
    for left in path.parent.glob(f"{path.name}*"):
        left.unlink()


def begun(path: Path) -> bool:
    """Whether the configuration was committed; before that no run exists that could be resumed."""
    if not path.exists():
        return False
    try:
        read_journal(path, frames=False)
    except RecordError as problem:
        if "never begun" in str(problem) or "it is empty" in str(problem):
            return False
        raise
    return True


@dataclass(frozen=True)
class Whole:
    """A search that was not killed."""

    steps: int
    result: bytes
    happened: Happened
    file_bytes: int


@cache
def whole(name: str) -> Whole:
    """Content of a search's journal at its end, run in this process."""
    path = new_path()
    with Path(os.devnull).open("wb") as nobody:
        steps = SEARCHES[name].live(path, ack_fd=nobody.fileno(), blows_at=None, resume=False)
    held = read_journal(path)
    file_bytes = path.stat().st_size
    remove(path)
    return Whole(
        steps=steps,
        result=msgspec.json.encode(result_of(held)[1]),
        happened=happened(held),
        file_bytes=file_bytes,
    )


def require_resumed(search: Search, path: Path, *, acknowledged: int, row: Row, tally: Tally) -> None:
    """Resume in this process from what a kill left, and compare with the whole search; counted in a row.

    Raises
    ------
    MismatchError
        If anything but the whole search comes out.
    """
    row.kills += 1
    row.acknowledged += acknowledged
    if acknowledged == 0 and not begun(path):
        remove(path)
        return
    row.begun += 1
    wanted = whole(search.name).happened
    kept = happened(read_journal(path))
    row.lost += max(acknowledged - len(kept), 0)
    if acknowledged > len(kept):
        raise MismatchError(f"{acknowledged} events were acknowledged, {len(kept)} are kept")
    if kept != wanted[: len(kept)]:
        raise MismatchError("what is kept is not what happened")
    broken_off = mid_sweep([event for event, *_ in kept])
    if len(kept) < len(wanted):
        policy, rig, _ = search.begin()
        journal, held = Journal.reopen(path)
        with journal, arming_watched(rig):
            for _ in resumed(policy, rig, journal, held, by=PERSON):
                pass
        tally.note("resumes in which nothing moved or fired before a person armed the rig")
    if broken_off is None:
        require_whole(path, wanted, whole(search.name).result)
    else:
        _require_swept_anew(path, broken_off, kept)
        tally.note("resumes that swept again, from where the sweep that was broken off began, and found the marker")
    row.equal += 1
    remove(path)


def mid_sweep(events: Sequence[object]) -> Asked | None:
    """The sweep that a run was in when it has measured some of it; None where it was in none."""
    sweep: Asked | None = None
    for event in events:
        if isinstance(event, Asked):
            sweep = event if event.sweep is not None else None
        elif isinstance(event, Swept):
            sweep = None
    return None if not events or isinstance(events[-1], Asked) else sweep


def _require_swept_anew(path: Path, broken_off: Asked, kept: Happened) -> None:
    """Refuse a resumed run that does not keep what it had, sweep again, and find the marker."""
    held = read_journal(path)
    events = [event for event, *_ in happened(held)]
    if happened(held)[: len(kept)] != kept:
        raise MismatchError("what was kept has changed")
    again = next((event for event in events[len(kept) :] if isinstance(event, Asked)), None)
    # None where what was measured before the kill was enough, and the probe was braking.
    if again is None or again.sweep not in (broken_off.sweep, None):
        raise MismatchError(f"a sweep was broken off ({broken_off.sweep}), and not made again: {again}")
    last = events[-1]
    found = isinstance(last, Finished) and isinstance(last.estimate, Found)
    if not (found and abs(last.estimate.mean_deg - MARKER_DEG) <= OFF_DEG):
        raise MismatchError(f"the marker at {MARKER_DEG} deg was not found: {last}")
    if faults := verify(path).faults:
        raise MismatchError(f"the journal has faults: {faults[0]}")


def require_whole(path: Path, wanted: Happened, result: bytes) -> None:
    """Refuse a journal that differs from that of the run that was not killed."""
    held = read_journal(path)
    if happened(held) != wanted:
        raise MismatchError("the resumed search is not the one that was not killed")
    if msgspec.json.encode(result_of(held)[1]) != result:
        raise MismatchError("the result of the resumed search differs")
