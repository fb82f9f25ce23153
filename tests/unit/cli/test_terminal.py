"""JSON for programs, and the progress of a long task where standard error is no terminal."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit

from markerseek._compiled import on_compiling
from markerseek.cli.doctor import CheckResult
from markerseek.cli.terminal import ProgressLines, print_json, time_left


def test_lines_say_what_begins_and_at_least_every_30_s_what_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    clock = iter(range(1000))
    lines = ProgressLines(now_s=lambda: float(next(clock)))
    # One step a second, of which 100 were done by an earlier run.
    for done in range(100, 401):
        lines.advance("searches [a]", done, 400)
    printed = capsys.readouterr().err.splitlines()
    assert printed[0] == "searches [a]: 300 to do"
    assert [line.partition(": ")[2] for line in printed[1:]] == [
        "102 of 400, some 5 min left",
        "104 of 400, some 5 min left",
        "108 of 400, some 5 min left",
        "116 of 400, some 5 min left",
        "132 of 400, some 4 min left",
        "162 of 400, some 4 min left",
        "192 of 400, some 3 min left",
        "222 of 400, some 3 min left",
        "252 of 400, some 2 min left",
        "282 of 400, some 2 min left",
        "312 of 400, some 88 s left",
        "342 of 400, some 58 s left",
        "372 of 400, some 28 s left",
    ]


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.1, "some 1 s"), (89, "some 89 s"), (600, "some 10 min"), (9000, "some 2.5 h")]
)
def test_a_duration_has_the_unit_that_suits_it(seconds: float, words: str) -> None:
    assert time_left(seconds) == words


COMPILING = """
import numpy as np
from markerseek.cli.terminal import announce_compilation
from markerseek.search.posterior.grid import _tops
announce_compilation()
announce_compilation()
print("begun")
_tops(np.zeros((2, 3), dtype=np.float32))
"""
"""A program that runs one kernel."""


def test_the_kernels_are_announced_only_when_one_is_compiled(tmp_path: Path) -> None:
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", COMPILING],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        announced = "compiling the kernels of this command: it takes some 15 seconds more, later ones like it do not"
        said.append(done.stderr.count(announced))
        tmp_path.chmod(0o500)
    assert said == [1, 0], done.stderr


def test_kernels_that_no_folder_keeps_are_announced_at_each_start(capsys: pytest.CaptureFixture[str]) -> None:
    from markerseek.cli.terminal import _say_compiling

    def ours(value: float) -> float:
        return value

    def theirs(value: float) -> float:
        return value

    ours.__module__ = "markerseek.acoustics"
    on_compiling(_say_compiling)
    njit(theirs)(1.0)
    assert capsys.readouterr().err == ""
    njit(ours)(1.0)
    assert "as each start does: no folder for compiled code can be written" in capsys.readouterr().err


def test_a_name_that_is_no_unicode_is_escaped_wherever_it_stands(capsys: pytest.CaptureFixture[str]) -> None:
    finding = CheckResult(what="r\udcff.toml", state="ok", detail="")
    print_json({"findings": [finding], "names": ("a\udcfe",)})
    printed = json.loads(capsys.readouterr().out)
    assert (printed["findings"][0]["what"], printed["names"]) == ("r\\udcff.toml", ["a\\udcfe"])
