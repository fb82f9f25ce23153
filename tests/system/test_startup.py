"""Imports of the quick commands: none of the packages that they do not need.

`markerseek.core` takes msgspec, of which its values are made: 57 ms of processor time, 71 ms before they were. A start
without any value takes 8 ms, and goes without it.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("numpy", "scipy", "numba", "jaxtyping", "matplotlib", "h5py", "msgspec", "rich", "typer")
"""Packages whose import a user feels."""


def imported(program: str) -> set[str]:
    """Which of them a program has imported at its end."""
    whole = (
        f"import atexit, sys\natexit.register(lambda: print([each for each in {HEAVY} if each in sys.modules], "
        f"file=sys.stderr))\n{program}"
    )
    done = subprocess.run([sys.executable, "-c", whole], capture_output=True, text=True, check=True)
    listed = done.stderr.strip().splitlines()[-1]
    return {each for each in HEAVY if repr(each) in listed}


def command(*words: str) -> str:
    return f"sys.argv = {['markerseek', *words]}\nfrom markerseek.cli import main\nmain()"


@pytest.mark.parametrize(
    ("program", "allowed"),
    [
        ("import markerseek", set()),
        ("import markerseek.core", {"msgspec"}),
        ("from markerseek import Interval, MarkerseekError", {"msgspec"}),
        (command("--version"), set()),
        (command("--help"), {"msgspec", "rich", "typer"}),
        (command("search", "--help"), {"msgspec", "rich", "typer"}),
        (command("search", "--seed", "1", "--no-journal"), set(HEAVY) - {"jaxtyping", "matplotlib", "h5py"}),
        (command("journal", "list"), {"msgspec", "numpy", "rich", "scipy", "typer"}),
    ],
    ids=["package", "core", "names", "--version", "--help", "search --help", "search", "journal list"],
)
def test_heavy_packages_are_imported_only_where_they_are_needed(program: str, allowed: set[str]) -> None:
    assert imported(program) <= allowed


def test_a_search_imports_no_more_of_scipy_than_it_computes_with() -> None:
    program = command("search", "--seed", "1", "--no-journal")
    listing = "import atexit, sys\natexit.register(lambda: print(*sys.modules, file=sys.stderr))\n" + program
    done = subprocess.run([sys.executable, "-c", listing], capture_output=True, text=True, check=True)
    modules = set(done.stderr.split())
    for name in ("signal", "optimize", "interpolate", "stats", "sparse", "io"):
        assert f"scipy.{name}" not in modules
