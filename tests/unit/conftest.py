"""What the tests of several packages share: files that no child tries first, and a journal."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The journal of a run that was not stopped."""
    from tests.unit.runs.journalled_runs import live

    path = tmp_path_factory.mktemp("whole") / "run.journal"
    live(path)
    return path


@pytest.fixture(autouse=True, scope="module")
def _no_child(no_child: None) -> None:
    """Whole files need none."""
