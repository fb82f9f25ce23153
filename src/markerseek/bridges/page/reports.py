"""Reports that the page gives away, each made by the ordinary command."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

from markerseek.bridges.outcome import Outcome
from markerseek.core import SearchError

REPORT_S = 120.0
"""Longest time to draw a report, in seconds."""


@lru_cache(maxsize=1)
def make_search_report(journal: Path) -> dict[str, bytes]:
    """Return picture and page of a finished search, as file names and contents; errors as of `_made`."""
    made = _made(["resume", str(journal), "--plot"])
    return {f"search{Path(name).suffix}": content for name, content in made.items()}


def make_session_report(folder: Path) -> dict[str, bytes]:
    """Return the report of a session as it is now, as file names and contents; errors as of `_made`."""
    return _made(["register", "--report", str(folder)])


def _made(command: Sequence[str]) -> dict[str, bytes]:
    """Return the files that a command writes into a folder of its own.

    Raises `SearchError` if it writes none, and `OSError` or `TimeoutExpired` if it cannot be run, or not to its end.
    """
    with tempfile.TemporaryDirectory() as folder:
        # -P: a file in the current folder must not replace a module.
        done = subprocess.run(  # noqa: S603  no shell; the paths are those that this page keeps
            [sys.executable, "-P", "-m", "markerseek", *command, "--out", folder, "--json"],
            capture_output=True,
            timeout=REPORT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        made = {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}
        if not made:
            raise SearchError(Outcome.of(done.returncode, done.stdout).message)
        return made
