"""The data folder of the system tests, and files that no child tries first."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _own_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Journals without a given path go into a folder of the test, also from processes that it starts."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture(autouse=True, scope="module")
def _no_child(no_child: None) -> None:
    """Whole files need none."""
