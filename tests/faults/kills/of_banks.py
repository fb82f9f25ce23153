"""Kills of `markerseek bank scan`: at random times, and at every write of an event and of the bank made at the end.

What must hold: the bank, or the record that becomes one, holds the first acquisitions of the whole scan bit for bit,
and they are those that were acknowledged or one more.
"""

from __future__ import annotations

import os
import random
import re
import signal
from collections.abc import Generator, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import cache, partial
from itertools import count
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from markerseek import runs
from markerseek.core import Event, Measured, RecordError
from markerseek.records.banks import FrameBank, record_of
from markerseek.records.banks.ipasc.reading import IpascBank, read_probed
from markerseek.records.journal import Journal
from markerseek.runs import bank_scan

from .at_times import rig_file
from .ground import new_path, remove
from .problems import watched
from .processes import End, Lifetime, MismatchError, _command, command, require_well, warm
from .searches import SEED
from .tally import Row, Tally
from .tracing import around, killed_at_write

KIND = "bank scan"
STEP_DEG = 5.0
EARLY = 6
"""Acquisitions, dark ones included, after which a scan is stopped by Ctrl-C before its end."""

_FEWEST = 3
"""Angles of the smallest bank; the record of a scan that died before opens, and is refused for this."""


def _words(path: Path) -> list[str]:
    words = ("bank", "scan", path, "--rig", rig_file(), "--seed", SEED, "--step-deg", STEP_DEG, "--json")
    return [str(word) for word in words]


def _prepared(
    ack_fd: int, *, stop_after: int | None = None, trace: tuple[Any, str] | None = None, row: int = 0
) -> None:
    """Acknowledge each acquisition, stop by Ctrl-C after `stop_after`, and count the writes of one step."""
    scan = runs.scan_bank

    def acknowledging(*args: Any, **named: Any) -> Generator[Event, None, None]:
        taken = 0
        with closing(scan(*args, **named)) as events:
            for event in events:
                if isinstance(event, Measured):
                    os.write(ack_fd, b"." if event.role == "search" else b"d")
                    taken += 1
                    if taken == stop_after:
                        os.kill(os.getpid(), signal.SIGINT)
                yield event

    mock.patch.object(runs, "scan_bank", acknowledging).start()
    if trace is not None:
        step = getattr(*trace)
        calls = iter(range(1 << 30))

        def counted(*args: Any, **named: Any) -> Any:
            return (around(step) if next(calls) == row else step)(*args, **named)

        mock.patch.object(*trace, counted).start()


@dataclass(frozen=True)
class WholeScan:
    """A scan that was not killed: its acquisitions in order."""

    angles_deg: tuple[float, ...]
    frames: dict[float, bytes]
    intensities: dict[float, float]
    started_s: dict[float, float]
    dark: tuple[bytes, ...]
    lifetime: Lifetime


@cache
def whole_scan() -> WholeScan:
    """The scan, done once by the command."""
    warm(*_words(new_path(".hdf5")))
    path = new_path(".hdf5")
    end = command(*_words(path), out=path, before=_prepared)
    require_well(end, 0)
    bank = _opened(path)
    if not isinstance(bank, IpascBank):
        raise MismatchError("its bank was not written")
    order = np.argsort(bank.columns.rows)
    whole = WholeScan(
        angles_deg=tuple(bank.angles_deg[place] for place in order),
        frames=dict(_frames(bank)),
        intensities=dict(zip(bank.angles_deg, bank.intensities, strict=True)),
        started_s=dict(zip(bank.angles_deg, bank.started_s, strict=True)),
        dark=tuple(bank.dark_frame(index).samples.tobytes() for index in range(bank.dark_frames)),
        lifetime=Lifetime(end.acknowledged + _dark_acknowledged(end), end.first_s, end.took_s),
    )
    remove(path)
    return whole


def _opened(path: Path) -> FrameBank:
    """The bank, or that of the record while there is none."""
    bank = read_probed(path) if path.exists() else runs.journal_bank(record_of(path))
    if not isinstance(bank, FrameBank):
        raise MismatchError("it holds no frames")
    return bank


def _frames(bank: FrameBank) -> Iterator[tuple[float, bytes]]:
    for index, angle_deg in enumerate(bank.angles_deg):
        yield angle_deg, bank.frame(index).samples.tobytes()


def at_random_times(seed: int, first: int, runs: int) -> Tally:
    """Kill scans at random times from the creation of the file on."""
    tally = Tally()
    for number in range(first, first + runs):
        chance = random.Random(f"{seed} scan {number}")
        while True:
            path = new_path(".hdf5")
            death = whole_scan().lifetime.death(chance)
            end = command(*_words(path), out=path, death=death, before=_prepared)
            if end.killed:
                break
            remove(path)
        with watched(tally, path, f"{KIND}, {death}"):
            _left_well(path, end, tally.row(KIND, "random time"), tally)
    return tally


STEPS: dict[str, dict[str, Any]] = {
    "a later event": {"trace": (Journal, "commit"), "row": 2 * EARLY},
    "the bank": {"trace": (bank_scan, "_export")},
    "the bank after Ctrl-C": {"trace": (bank_scan, "_export"), "stop_after": EARLY},
}
"""Steps of a scan that are killed at every write, by what `_prepared` must do."""


def at_every_write(step: str, every: int) -> Tally:
    """Kill a scan just before the n-th write of a step, for n = 1, 1 + every, ... until the step has fewer."""
    tally = Tally()
    whole_scan()
    for number in count(1, every):
        path = new_path(".hdf5")
        with watched(tally, path, f"{KIND}, {step}, killed at write {number}"):
            end = killed_at_write(partial(_scan, path, STEPS[step]), number)
            if not end.killed:
                require_well(end, 130 if "stop_after" in STEPS[step] else 0)
                remove(path)
                break
            system_call = end.place.replace("d", "", _dark_acknowledged(end))
            tally.point(f"before: {system_call}", KIND)
            _left_well(path, end, tally.row(KIND, f"every write of: {step}"), tally)
    return tally


def _scan(path: Path, prepare: dict[str, Any], *, ack_fd: int) -> None:
    _prepared(ack_fd, **prepare)
    _command(_words(path), path, ack_fd=ack_fd)


def _dark_acknowledged(end: End) -> int:
    """Dark frames that were acknowledged: letters d before the name of a system call."""
    return len(re.match("d*", end.place)[0]) if end.place else 0  # type: ignore[index]


def _left_well(path: Path, end: End, row: Row, tally: Tally) -> None:
    row.kills += 1
    row.acknowledged += end.acknowledged
    left = path.exists() or record_of(path).exists()
    if end.acknowledged == 0 and not _dark_acknowledged(end) and not left:
        _remove_all(path)
        return
    row.begun += 1
    kept = _taken(path, end, tally)
    row.lost += max(end.acknowledged - kept, 0)
    if not end.acknowledged <= kept <= end.acknowledged + 1:
        raise MismatchError(f"{end.acknowledged} angles were acknowledged, {kept} are in the bank")
    row.equal += 1
    _remove_all(path)


def _taken(path: Path, end: End, tally: Tally) -> int:
    """Angles in the bank, which must be the first of the whole scan."""
    whole = whole_scan()
    try:
        bank = _opened(path)
    except RecordError as problem:
        said = re.search(rf"it holds (\d+) angles, at least {_FEWEST} are needed", str(problem))
        if said is None or end.acknowledged >= _FEWEST:
            raise
        tally.note("scans that died with fewer than 3 angles, opened, and refused for that")
        return int(said[1])
    kept = len(bank.angles_deg)
    if sorted(whole.angles_deg[:kept]) != list(bank.angles_deg):
        raise MismatchError("its angles are not the first of the whole scan")
    for (angle_deg, samples), intensity, started_s in zip(_frames(bank), bank.intensities, bank.started_s, strict=True):
        if (samples, intensity, started_s) != (
            whole.frames[angle_deg], whole.intensities[angle_deg], whole.started_s[angle_deg],
        ):  # fmt: skip
            raise MismatchError(f"what it holds at {angle_deg} deg is not what the whole scan holds")
    dark = tuple(bank.dark_frame(index).samples.tobytes() for index in range(bank.dark_frames))
    if dark != whole.dark[: len(dark)] or not _dark_acknowledged(end) <= len(dark):
        raise MismatchError(
            f"{_dark_acknowledged(end)} dark frames were acknowledged, {len(dark)} are in the bank, or others"
        )
    return kept


def _remove_all(path: Path) -> None:
    remove(path)
    record_of(path).unlink(missing_ok=True)
    for part in path.parent.glob(f".{path.name}.*.part"):
        part.unlink()
