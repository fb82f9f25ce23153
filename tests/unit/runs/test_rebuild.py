"""Reconstruction from a journal: what cannot be made again."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import RecordError
from markerseek.records.journal import Configuration, RecordedRun
from markerseek.runs import rebuild_rig
from tests.unit.runs.journalled_runs import configured


def recorded(configuration: Configuration) -> RecordedRun:
    return RecordedRun(path=Path("run.journal"), configuration=configuration, entries=())


def test_a_replay_and_a_rig_of_python_are_not_resumed(tmp_path: Path) -> None:
    scan = tmp_path / "scan.csv"
    rows = [f"{angle},{1 + 90 * 2.0 ** -((angle - 8) ** 2 / 9)}" for angle in range(-35, 36)]
    scan.write_text("angle_deg,intensity\n" + "\n".join(rows) + "\n")
    with pytest.raises(RecordError, match=f"it is of a recorded scan, which takes seconds: replay {scan} again"):
        rebuild_rig(recorded(configured(rigs.replayed(scan))))
    with pytest.raises(RecordError, match="from Python, with the rig"):
        rebuild_rig(recorded(configured(rigs.of_intensities(seed=1, curve=None, marker_deg=0.0))))
