"""A stage of a lab, written from the tutorial alone and outside of the package: doctor, search, kill, its errors."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from markerseek import rigs
from tests.emulated import markerseek, ran
from tests.waiting import wait_until

Shell = Callable[..., tuple[int, str, str]]

PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "own-stage.md"

pytestmark = pytest.mark.real_time


def blocks() -> dict[str, str]:
    """The files that the page tells to save."""
    text = PAGE.read_text(encoding="utf-8")
    saved = re.findall(r"Save this as `([\w.]+)`.*?^```\w+\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return dict(saved)


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of the page, in which the commands are given."""
    folder = tmp_path / "lab"
    folder.mkdir()
    for name, text in blocks().items():
        (folder / name).write_text(text, encoding="utf-8")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(folder)
    return folder


@contextmanager
def pretended(lab: Path) -> Iterator[Path]:
    """The device of the page; what it prints is in the file."""
    printed = lab / "printed.txt"
    with printed.open("w") as out:
        process = subprocess.Popen([sys.executable, "toy_device.py"], cwd=lab, stdout=out)
        try:
            wait_until(lambda: "ready" in printed.read_text())
            yield printed
        finally:
            process.kill()
            process.wait()
            (lab / "toy_port").unlink(missing_ok=True)


def changed(lab: Path, name: str, old: str, new: str) -> None:
    text = (lab / name).read_text(encoding="utf-8")
    assert old in text
    (lab / name).write_text(text.replace(old, new), encoding="utf-8")


def test_the_stage_of_the_page_passes_doctor_and_finds_the_marker(lab: Path) -> None:
    assert set(blocks()) == {"toy_stage.py", "toy_device.py", "rig.toml", "test_toy_stage.py"}
    with pretended(lab):
        told = ran("doctor", "--rig", "rig.toml", "--json", cwd=lab)
        findings = {each["what"]: each for each in json.loads(told.stdout)["findings"]}
        assert findings["rig.toml"]["state"] == "ok", findings["rig.toml"]
        rules = findings["contract of stage toy_stage:Stage"]
        assert rules["state"] == "ok"
        assert "Its readback at rest is a finite number of degrees inside its limits" in rules["detail"]
        journal = lab / "run.journal"
        searched = ran("search", "--rig", "rig.toml", "--arm", "--single", "--json", "--journal", journal, cwd=lab)
        assert searched.returncode == 0, searched.stderr
        for said in (
            f"FOREIGN DRIVER of the stage: toy_stage:Stage, of {lab}/toy_stage.py; when the search dies, the",
            "supervisor sends b'STOP\\n' to toy_port",
        ):
            assert said in " ".join(searched.stderr.split())
        result = json.loads(searched.stdout)
        assert (result["answer"], result["confirmed"]) == ("found", True)
        assert result["emulated"] == ["stage", "laser", "receiver"]
        # The world of a simulated rig with the same seed has its marker there.
        assert result["angle_deg"] == pytest.approx(rigs.simulated(seed=3).facts.truth_deg, abs=0.5)


def test_the_contract_of_the_page_passes(lab: Path) -> None:
    with pretended(lab):
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_toy_stage.py"]
        told = subprocess.run(command, cwd=lab, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stdout


def test_a_search_that_is_killed_leaves_the_stage_stopped_on_its_way(lab: Path) -> None:
    changed(lab, "rig.toml", "speed_deg_s = 25.0", "speed_deg_s = 3.0")
    with pretended(lab) as printed, (lab / "said.txt").open("w") as said:
        process = subprocess.Popen(
            markerseek("search", "--rig", "rig.toml", "--arm", "--journal", lab / "run.journal"),
            cwd=lab,
            stdout=said,
            stderr=said,
        )
        try:
            wait_until(lambda: "goes to" in printed.read_text())
            # It turns for a second.
            time.sleep(1.0)
        finally:
            process.kill()
            process.wait()
        wait_until(lambda: re.search(r"goes to (\S+) deg\nstopped at", printed.read_text()))
        target_deg, stopped_deg = map(
            float, re.findall(r"goes to (\S+) deg\nstopped at (\S+) deg", printed.read_text())[0]
        )
    # At 3 deg/s for a second, and the time that the supervisor takes.
    assert 1.0 < abs(stopped_deg) < min(abs(target_deg), 12.0)
