"""What a user waits for: the command line, the import, and the loop's own time."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.timing import Effort, Single, alone

SEARCH = "`markerseek search`, new process to result"
IMPORT = "`import markerseek`, new process"
LOOP = "loop, per acquisition"


def measure(effort: Effort) -> tuple[list[Single], list[str]]:
    """Times of new processes, and of a search on a recorded curve, whose devices cost nothing."""
    program = Path(sys.executable).with_name("markerseek")
    few = Effort(rounds=5, least=min(5, effort.least), budget_s=60.0)
    singles = [
        alone(SEARCH, lambda: _process(str(program), "search", "--seed", "1", "--json"), effort=few),
        alone(IMPORT, lambda: _process(sys.executable, "-c", "import markerseek"), effort=few),
        alone("Python alone, new process", lambda: _process(sys.executable, "-c", "pass"), effort=few),
        _loop(effort),
    ]
    return singles, ["new processes: a run before the first one timed fills the cache of compiled kernels"]


def _process(*arguments: str) -> None:
    done = subprocess.run(arguments, capture_output=True, check=False, env=dict(os.environ))
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {done.returncode}: {done.stderr.decode()[-500:]}")


def _loop(effort: Effort) -> Single:
    import markerseek

    with tempfile.TemporaryDirectory() as folder:
        scan = Path(folder) / "scan.csv"
        angle = np.arange(-35, 35.01, 0.25)
        intensity = 100 * np.exp(-4 * np.log(2) * ((angle - 4) / 10) ** 2) + 1
        rows = "\n".join(f"{a},{i}" for a, i in zip(angle.tolist(), intensity.tolist(), strict=True))
        scan.write_text(f"angle_deg,intensity\n{rows}\n")
        rig = markerseek.replayed(scan)

    def search() -> int:
        policy = markerseek.build(
            markerseek.SearchPlan(method="weighted-average", start_deg=rig.stage.angle_deg), limits=rig.limits.search
        )
        events = list(markerseek.run(policy, rig.scanner, rig.run_plan))
        return sum(isinstance(event, markerseek.Measured) for event in events)

    acquisitions = search()
    whole = alone("", search, effort=effort)
    return Single(
        work=LOOP,
        ms=whole.ms / acquisitions,
        least_ms=whole.least_ms / acquisitions,
        most_ms=whole.most_ms / acquisitions,
        processor_ms=whole.processor_ms / acquisitions,
        rounds=whole.rounds,
    )
