"""Kills a process in the middle of writes of a bank, and prints what the file then holds.

``python bank_kills.py FOLDER MOMENT COUNT`` says one JSON line for each of about COUNT places, the last ones among
them; `test_writer_kills.py` judges them. The HDF5 library writes through a file of Python here, so that each of its
writes can be counted, and torn.
"""

from __future__ import annotations

import io
import json
import os
import signal
import sys
from pathlib import Path

import h5py
import numpy as np

from markerseek.core import RecordError
from markerseek.records.banks.ipasc import BankWriter
from markerseek.records.banks.ipasc.reading import IpascBank, read_probed
from markerseek.records.banks.ipasc.writer import whole_bank
from tests.unit.records.banks.synthetic_banks import FACTS, counts, sample

PLANNED, TAKEN = 8, 5


class Deadline:
    """Counts what a process does to the disk, and kills it at one of them; 0 lets it live."""

    def __init__(self) -> None:
        self.place = self.done = 0

    def reached(self) -> bool:
        self.done += 1
        return self.done == self.place

    def step(self) -> None:
        if self.reached():
            os.kill(os.getpid(), signal.SIGKILL)


DEADLINE = Deadline()


class TornFile(io.FileIO):
    """A file whose last write before the end is done by half."""

    def write(self, data):
        if DEADLINE.reached():
            super().write(bytes(data)[: len(data) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return super().write(data)


Genuine = h5py.File


class CountedFile(Genuine):
    def __init__(self, name, mode="r", **options):
        if mode == "r" or not isinstance(name, str | Path):
            super().__init__(name, mode, **options)
            return
        if mode == "w":
            Path(name).write_bytes(b"")
        super().__init__(TornFile(name, "r+"), mode, **options)


def count_the_names() -> None:
    """Link, replace and unlink are counted before they are done."""
    for name in ("link", "replace", "unlink", "rename"):
        genuine = getattr(os, name)

        def counted(*arguments, _genuine=genuine, **options):
            DEADLINE.step()
            return _genuine(*arguments, **options)

        setattr(os, name, counted)


def scan(path: Path, moment: str, acknowledged: Path) -> None:
    """Write a bank, of which only the named moment counts."""
    if moment != "scanning":
        DEADLINE.done = -1_000_000
    writer = BankWriter(path, angles=PLANNED, dark_frames=2, facts=FACTS)
    for seed in (8, 9):
        writer.add(sample(0.0, seed=seed, dark=True))
    if moment == "adding":
        DEADLINE.done = 0
    for seed in range(TAKEN):
        writer.add(sample(10.0 - seed, seed=seed))
        acknowledged.write_text(str(seed + 1))
    if moment == "adding":
        return
    if moment == "closing":
        DEADLINE.done = 0
    writer.close()


def importing(path: Path, acknowledged: Path) -> None:
    with whole_bank(path, angles=TAKEN, facts=FACTS) as writer:
        for seed in range(TAKEN):
            writer.add(sample(10.0 - seed, seed=seed))
    acknowledged.write_text(str(TAKEN))


def left(path: Path) -> dict[str, object]:
    """Content of a killed process's file: its angles, and whether each frame is the acquired one."""
    if not path.exists():
        return {"there": False}
    try:
        bank = read_probed(path)
    except RecordError as problem:
        return {"there": True, "refused": str(problem)}
    assert isinstance(bank, IpascBank)
    equal = [np.array_equal(bank.frame(row).samples, counts(10 - int(deg))) for row, deg in enumerate(bank.angles_deg)]
    dark = [np.array_equal(bank.dark_frame(row).samples, counts(8 + row)) for row in range(bank.dark_frames)]
    return {"there": True, "angles": bank.angles_deg, "frames": equal, "dark": dark, "planned": bank.planned}


def killed(path: Path, moment: str, place: int) -> dict[str, object]:
    """What is left of a process that is killed at that place, and how far it came."""
    acknowledged = path.with_suffix(".txt")
    acknowledged.write_text("0")
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        DEADLINE.place, DEADLINE.done = place, 0
        if moment == "importing":
            importing(path, acknowledged)
        else:
            scan(path, moment, acknowledged)
        os.write(writing, str(DEADLINE.done).encode())
        os._exit(0)
    os.close(writing)
    _, status = os.waitpid(child, 0)
    done = os.read(reading, 100).decode()
    os.close(reading)
    came = int(acknowledged.read_text())
    acknowledged.unlink()
    files = sorted(each.name for each in path.parent.iterdir())
    return {"place": place, "status": status, "done": done, "acknowledged": came, "files": files} | left(path)


def main() -> None:
    folder, moment, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    h5py.File = CountedFile
    count_the_names()
    (folder / "0").mkdir()
    unharmed = killed(folder / "0" / "a.hdf5", moment, 0)
    sys.stdout.write(json.dumps(unharmed) + "\n")
    last = int(unharmed["done"])
    for place in sorted({*np.linspace(1, last, min(count, last)).astype(int).tolist(), *range(max(1, last - 5), last)}):
        (folder / str(place)).mkdir()
        sys.stdout.write(json.dumps(killed(folder / str(place) / "a.hdf5", moment, place)) + "\n")


if __name__ == "__main__":
    main()
