"""The campaign's figures as a text."""

from __future__ import annotations

import platform
import subprocess
import textwrap
from pathlib import Path

import h5py
import numpy as np

from tests.faults.campaign.tally import upper95

from .tally import Row, Tally

HEAD = f"{'kind':<18}{'killed':<30}{'kills':>7}{'begun':>7}{'events':>8}{'lost':>6}{'equal':>7}{'limit':>9}"


def report(tally: Tally, *, seed: int, every: int, took_s: float) -> str:
    """Tables of kills by kind and place, and by point of the program; then what did not hold."""
    total = Row()
    lines = [
        f"Commit {_commit()}, seed {seed}, {'every step' if every == 1 else f'one step in {every}'}",
        _versions(),
        "",
        HEAD,
    ]
    for kind, places in sorted(tally.rows.items()):
        for place, row in sorted(places.items()):
            lines.append(_line(kind, place, row))
            total.add(row)
    lines += [
        _line("all", "", total),
        "",
        "begun: a run or a bank existed; events: acknowledged before the death; lost: missing of them afterwards;",
        "equal: resumed (a bank: opened) and the same, bit for bit, as the run that was not killed (on benches, whose",
        "devices live on: resumed to its end, measured as before, pulses of light as many as permitted);",
        "limit: upper 95 % limit of the share that is not equal (Clopper-Pearson)",
        "",
        *(f"{count:>7}  {what}" for what, count in sorted(tally.notes.items())),
        "",
        "Kills by the step or system call:",
        *_points(tally),
        "",
        f"took {took_s:.0f} s",
    ]
    if tally.wrong:
        lines += ["", "What did not hold:", *tally.wrong]
    return "\n".join(lines) + "\n"


def _versions() -> str:
    ours = f"Python {platform.python_version()}, HDF5 {h5py.version.hdf5_version}"
    return f"{ours}, NumPy {np.__version__}, {platform.system()} {platform.machine()}"


def _line(kind: str, place: str, row: Row) -> str:
    limit = upper95(row.begun - row.equal, row.begun)
    counts = f"{row.kills:>7}{row.begun:>7}{row.acknowledged:>8}{row.lost:>6}{row.equal:>7}{limit:>9.1e}"
    return f"{kind:<18}{place:<30}{counts}"


def _points(tally: Tally) -> list[str]:
    kinds = sorted({kind for point in tally.points.values() for kind in point})
    head = f"{'':<28}" + "".join(f"{number:>6}" for number in range(1, len(kinds) + 1))
    names = ", ".join(f"{number} {kind}" for number, kind in enumerate(kinds, start=1))
    rows = [
        f"{point:<28}" + "".join(f"{counts.get(kind, 0):>6}" for kind in kinds)
        for point, counts in sorted(tally.points.items(), key=lambda each: each[0].split(": ")[::-1])
    ]
    return [*textwrap.wrap(names, 110), head, *rows]


def _commit() -> str:
    """Commit of the working tree, and whether package or campaign were changed since."""
    here = Path(__file__).parent
    described = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=False)
    words = ["git", "status", "--porcelain", "src", "tests/faults/kills"]
    changed = subprocess.run(words, cwd=here.parents[2], capture_output=True, text=True, check=False)
    return described.stdout.strip()[:12] + (" with changes" if changed.stdout.strip() else "")
