"""Kills at every step of a search, at every step of a resume, and in the middle of a write to the disk."""

from __future__ import annotations

import random
import resource
import signal
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path

from .ground import copy_of, folder, new_path, require_resumed, whole
from .problems import watched
from .processes import End, MismatchError, in_a_process, require_well
from .searches import SEARCHES, Search
from .tally import Tally

PLACES = (0.15, 0.55, 0.9)
"""Where a search has died, as shares of its steps, before its resume is killed at every step."""


def at_steps(name: str, numbers: Sequence[int]) -> Tally:
    """Kill a search at each of these steps; one beyond its last must live on."""
    search, tally = SEARCHES[name], Tally()
    # Before the first child: a bank that a child records for itself has another name, and so another fingerprint.
    last = whole(name).steps
    for number in numbers:
        path = new_path()
        with watched(tally, path, f"{name}, killed at step {number}"):
            end = in_a_process(partial(search.live, path, blows_at=number, resume=False))
            if _died(end, number, last=last):
                tally.point(end.place, name)
                require_resumed(
                    search, path, acknowledged=end.acknowledged, row=tally.row(name, "every step"), tally=tally
                )
    return tally


def _died(end: End, number: int, *, last: int) -> bool:
    require_well(end, 0)
    if end.killed != (number <= last):
        raise MismatchError(f"it has {last} steps, and {'died' if end.killed else 'lived on'} at {number}")
    return end.killed


@cache
def dead(name: str, place: float) -> tuple[Path, int]:
    """Journal of a search that died at a share of its steps, and the events acknowledged before."""
    path = folder() / f"dead {name} {place}"
    number = round(place * whole(name).steps)
    end = in_a_process(partial(SEARCHES[name].live, path, blows_at=number, resume=False))
    if not (end.killed and end.acknowledged > 0):
        raise MismatchError(f"{name} was to die at step {number}, with an event acknowledged")
    return path, end.acknowledged


@cache
def steps_of_resume(name: str, place: float) -> int:
    """How many steps the whole resume of that journal has."""
    steps: list[int] = []
    path = copy_of(dead(name, place)[0])
    with Path("/dev/null").open("wb") as nobody:
        steps.append(SEARCHES[name].live(path, ack_fd=nobody.fileno(), blows_at=None, resume=True))
    return steps[0]


def at_steps_of_resume(name: str, place: float, numbers: Sequence[int]) -> Tally:
    """Kill the process that resumes a dead search at each of these steps; one beyond its last must live on."""
    search, tally = SEARCHES[name], Tally()
    died, before = dead(name, place)
    for number in numbers:
        path = copy_of(died)
        with watched(tally, path, f"{name}, dead at {place} and killed at step {number} of the resume"):
            end = in_a_process(partial(search.live, path, blows_at=number, resume=True))
            if _died(end, number, last=steps_of_resume(name, place)):
                tally.point(end.place, f"{name}, resumed")
                row = tally.row(name, f"every step of a resume at {place:.0%}")
                require_resumed(search, path, acknowledged=max(before, end.acknowledged), row=row, tally=tally)
    return tally


def in_writes(name: str, seed: int, count: int) -> Tally:
    """Kill in the middle of a write, at a random byte of the file: in a search, or in a resume."""
    chance, tally = random.Random(f"{seed} {name}"), Tally()
    kinds = (_in_search, _in_resume)
    for number in range(count):
        _in_write(kinds[number % len(kinds)], SEARCHES[name], chance, tally)
    return tally


def _in_write(
    kind: Callable[..., tuple[str, Path, int, End]], search: Search, chance: random.Random, tally: Tally
) -> None:
    while True:
        place, path, before, end = kind(search, chance)
        with watched(tally, path, f"{search.name}, {place}, limit drawn at random"):
            require_well(end, 0)
            if not end.killed:
                continue
            require_resumed(
                search, path, acknowledged=max(before, end.acknowledged), row=tally.row(search.name, place), tally=tally
            )
        return


def _in_search(search: Search, chance: random.Random) -> tuple[str, Path, int, End]:
    path, size = new_path(), chance.randrange(1, whole(search.name).file_bytes)

    def work(*, ack_fd: int) -> None:
        _die_beyond(size)
        search.live(path, ack_fd=ack_fd, blows_at=None, resume=False)

    return "mid-write", path, 0, in_a_process(work)


def _in_resume(search: Search, chance: random.Random) -> tuple[str, Path, int, End]:
    died, before = dead(search.name, chance.choice(PLACES))
    path = copy_of(died)
    size = chance.randrange(path.stat().st_size, int(1.1 * whole(search.name).file_bytes))

    def work(*, ack_fd: int) -> None:
        _die_beyond(size)
        search.live(path, ack_fd=ack_fd, blows_at=None, resume=True)

    return "mid-write of a resume", path, before, in_a_process(work)


def _die_beyond(size: int) -> None:
    """Have the kernel kill this process in the middle of a write that would make a file larger than that."""
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
