"""Kills searches, scans and resumed searches with SIGKILL, and asks two questions of what is left.

Is everything readable that was acknowledged, and does the next run start? ``python -m tests.faults.kills --kills 500``.
A child acknowledges each event, once it is committed, by a byte in a pipe; the parent kills it after a random number of
bytes and a random time of at most the usual distance of two.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path

from markerseek import rigs, runs
from markerseek.core import Measured, SearchPlan
from markerseek.records.banks import read_bank, record_of
from markerseek.records.journal import Journal, JournalEvent, RunView, read_journal
from markerseek.rigs import Rig

METHODS = ("posterior", "ternary", "golden-section", "weighted-average")
SETTINGS = 'kind = "simulated"\n[marker]\nangle_deg = 6.3\n[probe.array]\nelements = 16\npitch_m = 0.43e-3\n'
LONGEST_S = 60.0
"""Longest time of a child, which then counts as hung."""


def rig_of(folder: Path) -> Rig:
    """A simulated rig of few elements."""
    path = folder / "small.toml"
    path.write_text(SETTINGS)
    return rigs.simulated(seed=5, settings=path)


def search(folder: Path, method: str) -> Iterable[JournalEvent]:
    """A new search."""
    rig = rig_of(folder)
    run = runs.new_run(rig, runs.plan_on(rig, SearchPlan(method=method, start_deg=0.0)))
    run.journal = Journal.create(folder / "run.journal", run.configuration)
    return run.events()


def resume(folder: Path) -> Iterable[JournalEvent]:
    """The same search, resumed."""
    journal, recorded = Journal.reopen(folder / "run.journal")
    rig = runs.rebuild_rig(recorded)
    return runs.resumed_run(rig, journal, recorded, by="a person", reset_fault=False).events()


def scan(folder: Path, *, goes_on: bool = False) -> Iterable[JournalEvent]:
    """A scan of 15 angles."""
    return runs.scan_bank(rig_of(folder), folder / "scan.hdf5", step_deg=5.0, goes_on=goes_on, by="a person")


def killed(events: Callable[[], Iterable[JournalEvent]], chance: random.Random, *, most: int) -> int:
    """Acknowledged events of a child that was killed after at most that many, or ended before."""
    wanted, read_fd, write_fd = chance.randint(0, most), *os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(read_fd)
            for _ in events():
                os.write(write_fd, b".")
            os._exit(0)
        except BaseException:  # noqa: BLE001  the parent shows what a child writes
            traceback.print_exc()
            os._exit(1)
    os.close(write_fd)
    acknowledged = 0
    with os.fdopen(read_fd, "rb", buffering=0) as pipe:
        while acknowledged < wanted and (byte := pipe.read(1)):
            acknowledged += len(byte)
        # At any moment of the next event.
        time.sleep(chance.uniform(0, 0.03))
        os.kill(child, signal.SIGKILL)
        acknowledged += len(pipe.read())
    _, status = os.waitpid(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status) != 0:
        raise AssertionError(f"the child ended with {os.WEXITSTATUS(status)} before it was killed")
    return acknowledged


def events_in(path: Path) -> int:
    """Events that can be read, those of a resumption too; 0 where the file was not begun."""
    return len(read_journal(path).entries) if path.exists() else 0


def angles(events: Iterable[JournalEvent]) -> int:
    """Acquisitions with light."""
    return sum(isinstance(event, Measured) and event.role == "search" for event in events)


def kill_a_search(folder: Path, chance: random.Random, *, times: int) -> None:
    """Kill a search, and its resumption, then resume it to its end."""
    method = chance.choice(METHODS)
    acknowledged = killed(lambda: search(folder, method), chance, most=24)
    path = folder / "run.journal"
    for _ in range(times):
        assert events_in(path) >= acknowledged, f"{acknowledged} acknowledged, {events_in(path)} readable"
        if not path.exists() or RunView.of(read_journal(path)).state == "finished":
            break
        before = events_in(path)
        acknowledged = before + killed(lambda: resume(folder), chance, most=12)
    else:
        before = events_in(path)
    if not path.exists():
        list(search(folder, method))
    elif RunView.of(read_journal(path)).state != "finished":
        list(resume(folder))
    assert RunView.of(read_journal(path)).state == "finished"


def kill_a_scan(folder: Path, chance: random.Random) -> None:
    """Kill a scan, and let the next one go on."""
    acknowledged = killed(lambda: scan(folder), chance, most=30)
    record = record_of(folder / "scan.hdf5")
    bank = folder / "scan.hdf5"
    if not bank.exists():
        assert events_in(record) >= acknowledged
        kept = [entry.event for entry in read_journal(record).entries] if record.exists() else []
        now = list(scan(folder, goes_on=record.exists()))
        assert angles(now) == 15 - angles(kept), f"{angles(now)} angles measured, {angles(kept)} were there"
    assert len(read_bank(bank).angles_deg) == 15


def kill(number: int, seed: int) -> None:
    """One run that is killed, in a folder of its own."""
    chance = random.Random(f"{seed} {number}")
    with tempfile.TemporaryDirectory() as folder:
        if number % 4 == 3:
            kill_a_scan(Path(folder), chance)
        else:
            kill_a_search(Path(folder), chance, times=1 + number % 3)


def main() -> None:
    """Kill as many runs as asked, and print what was lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    wrong = 0
    for number in range(options.kills):
        try:
            kill(number, options.seed)
        except Exception:  # noqa: BLE001  each is shown, and counted
            wrong += 1
            traceback.print_exc()
            sys.stderr.write(f"run {number} of seed {options.seed}\n")
    sys.stdout.write(
        f"{options.kills} runs killed, {wrong} of them not readable to the last acknowledged event, or not resumed\n"
    )
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
