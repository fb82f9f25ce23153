"""Kills of `markerseek search` and of `markerseek resume --arm` at random times."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from markerseek.cli.open_rig import NOT_ARMED
from markerseek.records.journal import read_journal, result_of, run_state

from .ground import Happened, begun, copy_of, folder, happened, new_path, remove, require_whole
from .problems import watched
from .processes import End, Lifetime, MismatchError, command, require_well, warm
from .searches import SEED
from .tally import Row, Tally

KIND = "command"

RIG = """kind = "simulated"
[marker]
angle_deg = 6.3
[probe.array]
elements = 32
pitch_m = 0.43e-3
"""

PACES = (0.0, 0.002, 0.01)
"""Without waits the time goes into reading frames and writing them; with them, into moves and acquisitions."""

_TRIES = 20
"""Most processes that are started until one dies before its end."""


@dataclass(frozen=True)
class WholeCommand:
    """A search by the command that was not killed."""

    printed: object
    result: bytes
    happened: Happened
    lifetime: Lifetime


def _search(path: Path, *, pace: float) -> list[object]:
    words = ["search", "--rig", rig_file(), "--seed", SEED, "--method", "ternary", "--acquisitions", 6, "--json"]
    return [*words, "--pace", pace, "--journal", path]


@cache
def rig_file() -> Path:
    """A simulated rig of few elements."""
    path = folder() / "small.toml"
    path.write_text(RIG)
    return path


@cache
def whole_command(pace: float) -> WholeCommand:
    """What the command prints and keeps at that pace."""
    warm(*_search(new_path(), pace=pace)[:-2], "--no-journal")
    path = new_path()
    end = command(*_search(path, pace=pace), out=path)
    require_well(end, 0, 3)
    held = read_journal(path)
    printed = json.loads(Path(f"{path}.out").read_text())
    remove(path)
    return WholeCommand(
        printed=printed,
        result=msgspec.json.encode(result_of(held)[1]),
        happened=happened(held),
        lifetime=Lifetime(end.acknowledged, end.first_s, end.took_s),
    )


def at_times(seed: int, first: int, count: int) -> Tally:
    """Kill searches at random times; every second one again while it is resumed."""
    tally = Tally()
    for number in range(first, first + count):
        chance = random.Random(f"{seed} {number}")
        pace = PACES[number // 2 % len(PACES)]
        _once(chance, pace, tally, twice=number % 2 == 1)
    return tally


def _once(chance: random.Random, pace: float, tally: Tally, *, twice: bool) -> None:
    wanted = whole_command(pace)
    path, end = _killed(chance, wanted, lambda path: _search(path, pace=pace), None)
    with watched(tally, path, f"{KIND} at pace {pace}{', killed twice' if twice else ''}"):
        rows = [tally.row(KIND, "random time")]
        acknowledged = end.acknowledged
        if not _left_well(path, acknowledged, rows[0], wanted):
            remove(path)
            return
        over = _says_and_does_nothing(path)
        if twice and not over:
            died = path
            path, end = _killed(chance, wanted, lambda path: ["resume", path, "--arm", "--json"], died)
            remove(died)
            rows.append(tally.row(KIND, "random time of the resume"))
            acknowledged = max(acknowledged, end.acknowledged)
            _left_well(path, acknowledged, rows[1], wanted)
        end = command("resume", path, "--arm", "--json", out=path)
        require_well(end, 0, 3)
        if json.loads(Path(f"{path}.out").read_text()) != wanted.printed:
            raise MismatchError("the resumed command prints another result")
        require_whole(path, wanted.happened, wanted.result)
        for row in rows:
            row.equal += 1
        tally.note("resumes in which nothing moved or fired before a person armed the rig", 0 if over else 1)
        remove(path)


def _killed(
    chance: random.Random, wanted: WholeCommand, words: Callable[[Path], list[object]], died: Path | None
) -> tuple[Path, End]:
    """A command on a new journal, or on a copy of a dead one, that was killed before its end."""
    for _ in range(_TRIES):
        path = new_path() if died is None else copy_of(died)
        end = command(*words(path), out=path, death=wanted.lifetime.death(chance))
        if end.killed:
            return path, end
        require_well(end, 0, 3)
        remove(path)
    raise MismatchError(f"{_TRIES} commands ended before they could be killed")


def _left_well(path: Path, acknowledged: int, row: Row, wanted: WholeCommand) -> bool:
    """Whether a kill left a run; no acknowledged event may be missing in it."""
    row.kills += 1
    row.acknowledged += acknowledged
    if acknowledged == 0 and not begun(path):
        return False
    row.begun += 1
    kept = happened(read_journal(path))
    row.lost += max(acknowledged - len(kept), 0)
    if acknowledged > len(kept):
        raise MismatchError(f"{acknowledged} events were acknowledged, {len(kept)} are kept")
    if kept != wanted.happened[: len(kept)]:
        raise MismatchError("what is kept is not what happened")
    return True


def _says_and_does_nothing(path: Path) -> bool:
    """Whether the run is over; if not, an unarmed resume must end with exit code 4 and leave it unchanged."""
    before = _bytes_of(path)
    end = command("resume", path, "--json", out=path)
    over = run_state(read_journal(path, frames=False).entries).state == "finished"
    if end.code not in ((0, 3) if over else (NOT_ARMED,)):
        raise MismatchError(f"an unarmed resume ended with exit code {end.code}")
    if _bytes_of(path) != before:
        raise MismatchError("an unarmed resume changed the journal")
    return over


def _bytes_of(path: Path) -> list[bytes]:
    return [part.read_bytes() for part in (path, Path(f"{path}-journal")) if part.exists()]
