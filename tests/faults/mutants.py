"""Mutation test of the safety kernel: mutmut's mutants, each run against the kernel's own tests.

``python -m tests.faults.mutants`` works in a folder of its own, prints the mutants that no test of ``tests/unit/guard``
noticed, and exits 1 if there is one.
"""

# ruff: noqa: T201 - a program, which prints

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[2]
MUTMUT = (sys.executable, "-m", "mutmut")


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        # The kernel's own tests, and what tests share.
        others = shutil.ignore_patterns("__pycache__", "test_*.py")
        shutil.copytree(ROOT / "tests" / "unit", folder / "tests" / "unit", ignore=others)
        shutil.copytree(ROOT / "tests" / "unit" / "guard", folder / "tests" / "unit" / "guard", dirs_exist_ok=True)
        for shared in (ROOT / "tests").glob("*.py"):
            shutil.copy(shared, folder / "tests")
        done = subprocess.run(
            [*MUTMUT, "run", "--max-children", "2"], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            print(done.stdout[-3000:], done.stderr[-3000:])
            return 1
        listed = subprocess.run(
            [*MUTMUT, "results", "--all", "true"], cwd=folder, capture_output=True, text=True, check=True
        )
        results = dict(line.strip().rsplit(": ", 1) for line in listed.stdout.splitlines() if ": " in line)
        unnoticed = sorted(mutant for mutant, result in results.items() if result != "killed")
        for mutant in unnoticed:
            shown = subprocess.run([*MUTMUT, "show", mutant], cwd=folder, capture_output=True, text=True, check=True)
            print(f"{mutant}: {results[mutant]}\n{shown.stdout}")
        counts = ", ".join(f"{count} {how}" for how, count in Counter(results.values()).items())
        print(f"{len(results)} mutants: {counts}")
        return 1 if unnoticed or not results else 0


if __name__ == "__main__":
    sys.exit(main())
