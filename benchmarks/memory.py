"""Memory of a study over its number of trials: ``python -m benchmarks.memory [TRIALS …]``.

The cheapest searches there are, on two workers. The peak is that of the largest process of the study, as the system
counts it when the process has ended.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TRIALS = (10_000, 100_000, 1_000_000)

STUDY = """
version = 1
trials = {trials}
[[policies]]
method = "ternary"
acquisitions = 2
as_published = true
[curve]
family = "sech"
fwhm_deg = 10.0
"""


def main() -> None:
    """Run the study for each number of trials, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.memory", description=__doc__)
    parser.add_argument("trials", type=int, nargs="*", default=TRIALS, help="numbers of trials")
    print("| trials | peak of the largest process, MB | time, s | table, MB |\n| --- | --- | --- | --- |")
    for trials in parser.parse_args().trials:
        with tempfile.TemporaryDirectory() as folder:
            study, out = Path(folder) / "cheapest.toml", Path(folder) / "out"
            study.write_text(STUDY.format(trials=trials), encoding="utf-8")
            words = ["study", str(study), "--workers", "2", "--out", str(out), "--json"]
            start = time.perf_counter()
            process = subprocess.Popen(
                [sys.executable, "-c", "from markerseek.cli import main; main()", *words], stdout=subprocess.DEVNULL
            )
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                raise RuntimeError(f"the study of {trials} trials ended with {process.returncode}")
            spent_s = time.perf_counter() - start
            table_mb = (out / "rows.csv").stat().st_size / 1e6
            print(f"| {trials} | {usage.ru_maxrss / 1e3:.0f} | {spent_s:.0f} | {table_mb:.1f} |", flush=True)


if __name__ == "__main__":
    main()
