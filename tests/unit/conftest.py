"""Helpers shared by several test files are modules beside them, such as `scan_bench`, imported by name."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of a run that was not stopped."""
    from journalled_runs import live

    path = tmp_path_factory.mktemp("whole") / "run.journal"
    live(path)
    return path


@pytest.fixture(autouse=True, scope="module")
def _one_sandbox(one_sandbox: None) -> None:
    """Sandboxes themselves are tested in `faults`, each with a child of its own."""
