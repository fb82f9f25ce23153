"""``markerseek study`` as a user types it, drawn, and stopped while its processes begin."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from markerseek import cli
from tests.emulated import markerseek

Shell = Callable[..., tuple[int, str, str]]

STUDY = """
version = 1
trials = 800
[[policies]]
method = "ternary"
acquisitions = 4
as_published = true
[[policies]]
method = "weighted-average"
acquisitions = 3
as_published = true
[curve]
family = "sech"
fwhm_deg = 12.0
"""

PICTURED = """
version = 1
trials = 2
level = "frames"
drawn = "everything"
stay = true
marks = [2, 4]
[[policies]]
method = "golden-section"
acquisitions = 6
as_published = true
[rig]
start_deg = -35.0
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_a_text_table_a_json_object_and_any_row_again(study: Path, tmp_path: Path, shell: Shell) -> None:
    study.write_text(STUDY.replace("800", "20"), encoding="utf-8")
    out = tmp_path / "out"
    code, text, err = shell("study", study, "--out", out, "--workers", 1)
    assert code == 0
    said = "mine: 40 simulated searches, level curves (2 policies, 1 cell, 20 trials) in 1 process"
    assert said in " ".join(err.split())
    for word in ("mine: 40 simulated searches", "ternary as published, 4", "cell 0", "100.0 %", "0 - 1", "rows.csv"):
        assert word in text
    code, text, _ = shell("study", study, "--out", out, "--json")
    said = json.loads(text)
    assert code == 0
    assert said == json.loads((out / "summary.json").read_bytes())
    assert [policy["trials"] for policy in said["policies"]] == [20, 20]
    with (out / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    code, text, _ = shell("study", study, "--row", 17, "--json")
    again = json.loads(text)
    assert code == 0
    assert {name: float(rows[17][name]) for name in ("mean_deg", "truth_deg", "error_deg", "travel_deg")} == {
        name: again[name] for name in ("mean_deg", "truth_deg", "error_deg", "travel_deg")
    }
    assert shell("study", study, "--row", 17)[1].count("\n") == len(again)


@pytest.mark.parametrize(
    ("change", "words", "message"),
    [
        (
            ("version", 'level = "pictures"\nversion'),
            (),
            "level is 'pictures', it must be one of: curves, frames",
        ),
        (("", ""), ("--row", "8000"), "has the rows 0 to 1599"),
        (("800", "5"), ("--out", "{other}"), "holds another study"),
        (("", ""), ("--row", "3", "--workers", "1"), "--workers 1: --row runs one row and writes nothing"),
        (("", ""), ("--row", "3", "--plot"), "--plot: --row runs one row and writes nothing"),
    ],
)
def test_wrong_usage_ends_with_2_and_the_cure(
    study: Path,
    tmp_path: Path,
    shell: Shell,
    change: tuple[str, str],
    words: tuple[str, ...],
    message: str,
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "study.json").write_text(json.dumps({"hash": "0123", "version": cli.__version__}))
    study.write_text(STUDY.replace(*change), encoding="utf-8")
    given = [word.format(other=other) for word in words]
    code, text, err = shell("study", study, *given, "--json")
    assert code == 2
    assert message in json.loads(text)["error"]
    assert message in " ".join(err.split())


def test_a_study_is_drawn(tmp_path: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.toml").write_text(PICTURED, encoding="utf-8")
    code, out, _ = shell("study", "one.toml", "--workers", 1, "--plot")
    assert (code, "picture: out/one/error.png" in out) == (0, True)
    assert "<svg" in Path("out/one/error.svg").read_text(encoding="utf-8")[:500]
    assert Path("out/one/error.png").read_bytes().startswith(b"\x89PNG")
    code, out, _ = shell("study", "one.toml", "--workers", 1, "--json")
    (policy,) = json.loads(out)["policies"]
    assert (code, policy["any_error_deg"]["count"], len(policy["marks_deg"])) == (0, 2, 2)


@pytest.mark.skipif(sys.platform != "linux", reason="reads the processes of the study from /proc")
def test_ctrl_c_ends_a_study_and_its_processes_with_one_sentence(study: Path, tmp_path: Path) -> None:
    """The signal goes to all processes, as from a terminal, while the workers are still importing."""
    command = markerseek("study", study, "--workers", 2, "--out", tmp_path / "out")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    # two workers, and the process in which multiprocessing tracks shared resources
    while process.poll() is None and len(children.read_text().split()) < 3:
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"Traceback" not in said
    assert "stopped by the user; finished rows are in" in " ".join(said.decode().split())
    assert said.count(b"stopped by the user") == 1
