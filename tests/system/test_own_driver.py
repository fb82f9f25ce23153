"""Drivers of a lab from the templates of `examples/plugin`: installed by entry points, and a receiver that searches."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.emulated import emulation, ran

PLUGIN = Path(__file__).parents[2] / "examples" / "plugin"
PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "own-stage.md"

pytest.importorskip("serial", reason="needs the extra devices")


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """The environment of a computer on which the plugin is installed."""
    site = tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "--target", site, copied(tmp_path)], check=True)
    return os.environ | {"PYTHONPATH": str(site), "XDG_DATA_HOME": str(tmp_path / "data")}


def copied(folder: Path) -> Path:
    """The plugin, in a folder in which it may be built."""
    copy = folder / "plugin"
    copy.mkdir()
    for path in PLUGIN.iterdir():
        if path.is_file():
            (copy / path.name).write_bytes(path.read_bytes())
    return copy


def test_a_template_is_short_and_is_the_page_s() -> None:
    for name in ("toy_stage.py", "toy_laser.py", "toy_receiver.py"):
        assert len((PLUGIN / name).read_text(encoding="utf-8").splitlines()) <= 42
    assert (PLUGIN / "toy_stage.py").read_text(encoding="utf-8") in PAGE.read_text(encoding="utf-8")


@pytest.mark.real_time
def test_installed_drivers_are_found_by_their_names_and_a_receiver_finds_the_marker(
    installed: dict[str, str], tmp_path: Path
) -> None:
    toy = tmp_path / "toy.toml"
    tables = '[laser]\ndriver = "simulated"\n[receiver]\ndriver = "simulated"\n'
    toy.write_text(f'kind = "bench"\n[stage]\ndriver = "toy"\nport = "{tmp_path}/none"\n{tables}')
    # Its keys are those of the class.
    done = ran("doctor", "--rig", toy, env=installed)
    refused = " ".join((done.stdout + done.stderr).split())
    assert "the key stage.zero_deg is missing; add it: toy needs it" in refused
    with emulation(tmp_path, "--receiver", "vantage", seed=3, pace=0.05) as devices:
        text = devices.rig.read_text(encoding="utf-8")
        ours = re.sub(
            r'driver = "vantage"\nprobe = "\w+"\nport = (\d+)\nquiet_s = 0.5',
            r'driver = "toy-receiver"\nport = \1\nemulated = true',
            text,
        )
        assert ours != text
        devices.rig.write_text(ours, encoding="utf-8")
        words = ("--arm", "--single", "--json", "--journal", tmp_path / "run.journal")
        told = ran("search", "--rig", devices.rig, *words, env=installed)
        said = devices.ended()
    assert told.returncode == 0, told.stderr
    result = json.loads(told.stdout)
    assert result["answer"] == "found"
    assert "receiver" in result["emulated"]
    truth = re.search(r"the marker is at (\S+) deg", said)
    assert truth is not None
    assert result["angle_deg"] == pytest.approx(float(truth[1]), abs=0.5)
