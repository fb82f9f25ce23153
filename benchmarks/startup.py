"""Start-up of the commands: seconds from process to result, and their ratio to another installation, run in turns.

    python benchmarks/startup.py --other /path/to/other/.venv/bin/markerseek

A shared machine is never quiet for long: the two take turns, and the ratio of each pair is what counts. Beside the
seconds on the wall stand those of computing, which other people's programs disturb less.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

COMMANDS: dict[str, tuple[tuple[str, ...], float]] = {
    "--version": (("--version",), 0.2),
    "--help": (("--help",), 0.5),
    "search": (("search", "--seed", "1", "--no-journal"), 1.2),
}
"""Commands, and the longest time that each should take, in seconds."""


def seconds(program: str, words: tuple[str, ...]) -> tuple[float, float]:
    """Seconds of one process on the wall, and of computing."""
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([program, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    wall_s, after = time.perf_counter() - began_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def shown(runs: list[tuple[float, float]]) -> str:
    """Median and fastest of some runs."""
    wall_s, computing_s = zip(*runs, strict=True)
    wall = f"{statistics.median(wall_s):5.2f} s (fastest {min(wall_s):.2f})"
    return f"{wall}, computing {statistics.median(computing_s):.2f} (least {min(computing_s):.2f})"


def main() -> None:
    """Print each command's times, and the median ratio to the other installation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", help="another markerseek to compare with")
    parser.add_argument("--runs", type=int, default=9)
    given = parser.parse_args()
    ours = str(Path(sys.executable).with_name("markerseek"))
    for name, (words, target_s) in COMMANDS.items():
        seconds(ours, words)
        mine, theirs = [], []
        for _ in range(given.runs):
            mine.append(seconds(ours, words))
            if given.other is not None:
                theirs.append(seconds(given.other, words))
        print(f"{name:10} {shown(mine)}, target {target_s:g} s")
        if theirs:
            wall, computing = (
                statistics.median(new[part] / old[part] for new, old in zip(mine, theirs, strict=True))
                for part in (0, 1)
            )
            print(f"{'other':>10} {shown(theirs)}; ratio {wall:.2f}, of computing {computing:.2f}")


if __name__ == "__main__":
    main()
