"""A short version of the campaign of `kills`: nothing is lost, every search is resumed to its result."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_searches_and_scans_that_are_killed_lose_nothing_and_resume_to_the_same_result() -> None:
    pytest.importorskip("h5py", reason="needs the extra records")
    words = ["--kills", "12", "--scans", "3", "--benches", "0", "--every", "60", "--seed", "5"]
    program = [sys.executable, "-m", "tests.faults.kills", *words]
    done = subprocess.run(program, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    first_table = done.stdout.partition("\nbegun: ")[0]
    rows = {
        (kind, place): [int(figure) for figure in figures.split()]
        for kind, place, figures in re.findall(r"^(\S.{17})(\S.{29})((?: +\d+){5}) +\S+$", first_table, re.M)
    }
    rows = {(kind.strip(), place.strip()): figures for (kind, place), figures in rows.items()}
    kinds = {kind for kind, _ in rows}
    assert kinds == {"intensities", "sweeps", "triggered sweeps", "frames", "replayed frames", "command", "bank scan"}
    for where, (kills, begun, acknowledged, lost, equal) in rows.items():
        assert kills >= 1, where
        assert (lost, equal) == (0, begun), where
        assert acknowledged > 0 or begun < 3, where
    steps = [figures for (_, place), figures in rows.items() if "step" in place]
    assert len(steps) == 14
    assert sum(figures[1] for figures in steps) >= 40


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_search_that_hands_on_before_it_commits_is_detected(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "tests.faults.kills.hasty"]
    there = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(program, cwd=ROOT, env=there, capture_output=True, text=True, check=True)
    kills, lost, wrong = map(int, done.stdout.split())
    assert kills == 12
    assert 0 < lost <= wrong
