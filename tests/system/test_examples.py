"""The examples run unchanged, and the committed scan is the output of its script."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def test_the_example_finds_the_marker_by_both_loops(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(ROOT / "examples" / "find_a_marker.py"))
    out = capsys.readouterr().out
    found = [float(number) for number in re.findall(r"Found\(mean_deg=(-?[\d.]+)", out)]
    truth = float(re.findall(r"truth: (-?[\d.]+) deg", out)[0])
    assert len(found) == 2
    assert np.abs(np.array(found) - truth).max() < 0.75


def test_the_committed_scan_is_the_one_that_its_script_makes(tmp_path: Path) -> None:
    script = tmp_path / "make_simulated_scan.py"
    script.write_text((ROOT / "examples" / "make_simulated_scan.py").read_text(encoding="utf-8"), encoding="utf-8")
    subprocess.run([sys.executable, script], check=True)
    kept, made = (
        np.loadtxt(path / "simulated_scan.csv", delimiter=",", skiprows=1) for path in (ROOT / "examples", tmp_path)
    )
    np.testing.assert_allclose(made, kept, rtol=1e-3, atol=0.02)


def test_the_commands_of_the_readme_exist(shell: Callable[..., tuple[int, str, str]]) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"^make ([a-z]+)$", readme, re.MULTILINE)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    commands = set(re.findall(r"`markerseek ([a-z0-9]+)[ `]", readme))
    assert len(commands) == 17
    for command in commands:
        assert shell(command, "--help")[0] == 0, command


def test_the_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"^```python\n(.*?)^```", readme, re.MULTILINE | re.DOTALL):
        exec(compile(block, "README.md", "exec"), {})
    assert "Found(mean_deg=" in capsys.readouterr().out
