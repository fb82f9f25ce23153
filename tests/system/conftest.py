"""The data folder of the system tests, files that no child tries first, and channel data about a marker."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.base_scan import base_scan


@pytest.fixture(autouse=True)
def _own_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Journals without a given path go into a folder of the test, also from processes that it starts."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture(autouse=True, scope="module")
def _no_child(no_child: None) -> None:
    """Whole files need none."""


@pytest.fixture(scope="session")
def angles_deg() -> np.ndarray:
    """Angles of `frames`: 7° to 18°, about the marker."""
    return base_scan().angles_deg[42:54]


@pytest.fixture(scope="session")
def frames() -> np.ndarray:
    """Channel data of the base scan, which a test must not change."""
    return base_scan().frames[42:54]
