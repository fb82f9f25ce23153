"""Kills searches and scans with -9, resumes each, and compares with the one that was not killed.

``python -m tests.faults.kills --workers 3 --out docs/explanation/kills.txt`` (a quarter of an hour; Linux). Each kill
is the death of a process of its own. What must hold after each: nothing is missing that was acknowledged (sent to the
process outside, over a pipe), nothing moved or fired in a resume before a person armed the rig, and the resumed search
ends with the same result, readings and frames, bit for bit. What does not hold is listed at the end of the report, with
the files that show it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from .at_steps import PLACES, at_steps, at_steps_of_resume, in_writes, steps_of_resume
from .at_times import at_times
from .ground import whole
from .of_banks import STEPS, at_every_write, at_random_times
from .of_benches import on_benches
from .problems import work_in
from .report import report
from .searches import SEARCHES
from .tally import Tally
from .tracing import can_trace

Job = Callable[[], Tally]

CHUNK = 30
"""Kills of one job, about."""


def chunks(last: int, *, every: int) -> Iterator[list[int]]:
    """Numbers of steps to die at, and one beyond the last, at which a search must live on; in pieces."""
    numbers = [*range(1, last + 1, every), last + 1]
    for first in range(0, len(numbers), CHUNK):
        yield numbers[first : first + CHUNK]


def jobs(words: argparse.Namespace) -> list[Job]:
    """All that is to be done, in pieces; the slow ones first."""
    seed = words.seed
    todo: list[Job] = []
    if words.benches:
        todo.append(partial(on_benches, seed, 0, words.benches))
    if can_trace():
        todo += [partial(at_every_write, step, words.every) for step in STEPS]
    runs = words.kills // 3
    todo += [partial(at_times, seed, first, min(CHUNK, runs - first)) for first in range(0, runs, CHUNK)]
    todo += [
        partial(at_random_times, seed, first, min(CHUNK, words.scans - first)) for first in range(0, words.scans, CHUNK)
    ]
    for name in SEARCHES:
        todo += [partial(at_steps, name, numbers) for numbers in chunks(whole(name).steps, every=words.every)]
        # What a resume of a sweep does that was broken off is in no run that was not killed.
        if SEARCHES[name].sweeps:
            continue
        todo.append(partial(in_writes, name, seed, words.kills // 6))
        for place in PLACES:
            last = steps_of_resume(name, place)
            todo += [partial(at_steps_of_resume, name, place, each) for each in chunks(last, every=words.every)]
    return todo


def carried_out(todo: list[Job], *, workers: int, folder: str) -> Tally:
    """The counts of all jobs."""
    tally = Tally()
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=work_in, initargs=(folder,)) as pool:
        for number, done in enumerate(as_completed([pool.submit(job) for job in todo]), start=1):
            tally.add(done.result())
            sys.stderr.write(f"\r{number} of {len(todo)} done, {len(tally.wrong)} wrong")
            sys.stderr.flush()
    sys.stderr.write("\n")
    return tally


def main() -> int:
    """Carry the campaign out and report; 1 if anything did not hold."""
    parser = argparse.ArgumentParser(description="kills searches and scans with -9, and resumes each")
    parser.add_argument("--kills", type=int, default=900, help="kills at random times and in mid-write, about")
    parser.add_argument("--scans", type=int, default=100, help="kills of scans at random times")
    parser.add_argument("--benches", type=int, default=10, help="searches killed on an emulated bench, 30 s each")
    parser.add_argument("--every", type=int, default=1, help="kill at every so manieth step only")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--out", type=Path)
    words = parser.parse_args()
    began_s = time.monotonic()
    # In memory, where there is room, so that no disk is waited for.
    ram = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(prefix="kills-", dir=ram) as folder:
        work_in(folder)
        tally = carried_out(jobs(words), workers=words.workers, folder=folder)
    text = report(tally, seed=words.seed, every=words.every, took_s=time.monotonic() - began_s)
    sys.stdout.write(text)
    if words.out is not None:
        words.out.write_text(text)
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
