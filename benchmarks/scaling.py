"""A study on one worker and on two, in turn: ``python -m benchmarks.scaling [--rounds N] [--trials N] [--no-dask]``.

Each turn is the command as a user types it, from a new process to its end, on processes of this machine or on a Dask
cluster that is already up. The tables of all turns must be the same, byte for byte. Beside them stands what the machine
has to give: the same searches in one bare process, and in two at once that share nothing.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

STUDY = Path(__file__).with_name("scaling.toml")

TARGET = 1.8
"""Time on one worker over that on two."""

BARE_CHUNKS = 40
"""Chunks of the study that a bare process computes."""

_BARE = """
import sys, time
from pathlib import Path
from itertools import islice
from markerseek.studies import read_study
from markerseek.studies.runner import chunks, run_chunk
study = read_study(Path(sys.argv[1]))
pieces = list(islice(chunks(study), int(sys.argv[2])))
run_chunk(study, pieces[0])
input()
start = time.perf_counter()
for piece in pieces:
    run_chunk(study, piece)
print(time.perf_counter() - start)
"""

MIN_S = 60.0
"""Time on one worker below which the ratio says nothing about a study."""


def main() -> None:
    """Measure, and print a table for each kind of worker."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scaling", description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="pairs of each kind (default 3)")
    parser.add_argument("--trials", type=int, help="trials of the study, instead of its own number")
    parser.add_argument("--no-dask", action="store_true", help="processes of this machine only")
    arguments = parser.parse_args()
    kinds: dict[str, Callable[[int], Iterator[list[str]]]] = {"processes": _processes}
    if not arguments.no_dask:
        kinds["Dask"] = _cluster
    with tempfile.TemporaryDirectory() as folder:
        study = Path(folder) / STUDY.name
        text = STUDY.read_text(encoding="utf-8")
        if arguments.trials is not None:
            text = re.sub(r"^trials = .*$", f"trials = {arguments.trials}", text, flags=re.MULTILINE)
        study.write_text(text, encoding="utf-8")
        _machine(study)
        tables: set[str] = set()
        for kind, workers in kinds.items():
            print(f"\n{kind}\n\n| round | one worker, s | two, s | ratio |\n| --- | --- | --- | --- |", flush=True)
            pairs = []
            for number in range(1, arguments.rounds + 1):
                one_s, two_s = (
                    _timed(study, contextmanager(workers)(count), Path(folder) / f"{kind}-{number}-{count}", tables)
                    for count in (1, 2)
                )
                pairs.append((one_s, two_s))
                print(f"| {number} | {one_s:.1f} | {two_s:.1f} | {one_s / two_s:.2f} |", flush=True)
            _judge(pairs)
    print(f"\ntables of all turns: {'byte for byte the same' if len(tables) == 1 else 'DIFFERENT'}")


def _machine(study: Path) -> None:
    """Print what two processes that share nothing gain over one, in three pairs."""
    ratios = []
    for _ in range(3):
        one_s, two_s = (_bare(study, count) for count in (1, 2))
        ratios.append(2 * one_s / two_s)
    print(f"the machine: two bare processes do {statistics.median(ratios):.2f} times the work of one", flush=True)


def _bare(study: Path, count: int) -> float:
    """Seconds until the last of so many bare processes has done its chunks."""
    command = [sys.executable, "-c", _BARE, str(study), str(BARE_CHUNKS)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    at_work = [subprocess.Popen(command, **pipes) for _ in range(count)]  # type: ignore[call-overload]
    time.sleep(3)
    for process in at_work:
        process.stdin.write("\n")
        process.stdin.flush()
    return max(float(process.communicate()[0]) for process in at_work)


def _processes(count: int) -> Iterator[list[str]]:
    yield ["--workers", str(count)]


def _cluster(count: int) -> Iterator[list[str]]:
    """A cluster of so many processes with one thread each, new for each turn, so that nothing is imported there yet."""
    from distributed import LocalCluster

    options = {"n_workers": count, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with LocalCluster(**options) as cluster:  # type: ignore[no-untyped-call]
        yield ["--scheduler", cluster.scheduler_address]


def _timed(study: Path, workers: AbstractContextManager[list[str]], out: Path, tables: set[str]) -> float:
    with workers as words:
        start = time.perf_counter()
        command = [sys.executable, "-c", "from markerseek.cli import main; main()", "study", str(study), *words]
        done = subprocess.run([*command, "--out", str(out), "--json"], capture_output=True, check=False)
        spent_s = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"the study ended with {done.returncode}: {done.stderr.decode()[-500:]}")
    tables.add(hashlib.sha256((out / "rows.csv").read_bytes() + (out / "summary.json").read_bytes()).hexdigest())
    return spent_s


def _judge(pairs: list[tuple[float, float]]) -> None:
    ratio = statistics.median(one / two for one, two in pairs)
    one_s = statistics.median(one for one, _ in pairs)
    if one_s < MIN_S:
        print(f"\nmedian ratio {ratio:.2f}; one worker takes less than {MIN_S:.0f} s: not judged")
    else:
        print(f"\nmedian ratio {ratio:.2f}, target ≥ {TARGET}: {'met' if ratio >= TARGET else 'MISSED'}")


if __name__ == "__main__":
    main()
