"""A rig with an emulated PLUS server as its receiver, from the command line, in real time."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = pytest.mark.real_time
for needed in ("serial", "thorlabs_apt_protocol", "pyigtl"):
    pytest.importorskip(needed, reason="needs the extras devices and igtl")

Shell = Callable[..., tuple[int, str, str]]

WORLD = """kind = "simulated"
[marker]
angle_deg = 6.4
[stage]
speed_deg_s = 25.0
acceleration_deg_s2 = 25.0
"""


def test_a_search_finds_the_marker_and_says_that_the_receiver_is_emulated(shell: Shell, tmp_path: Path) -> None:
    world, bench = tmp_path / "world.toml", tmp_path / "bench"
    world.write_text(WORLD)
    options = ("--dir", bench, "--rig", world, "--seed", "3", "--receiver", "plus")
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "markerseek", "emulate", "bench", *map(str, options)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as devices:
        try:
            said = "".join(iter(devices.stdout.readline, "Ctrl-C ends it\n"))
            assert "PLUS server: 127.0.0.1, port " in said
            rig = bench / "rig.toml"
            rig.write_text(rig.read_text().replace("quiet_s = 0.5", "quiet_s = 0.2"))
            search = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--no-journal")
            code, out, err = shell("search", "--rig", rig, "--arm", "--json", *search)
        finally:
            devices.kill()
    assert code == 0, err
    over_plus = json.loads(out)
    simulated = json.loads(shell("search", "--rig", world, "--seed", 3, "--json", *search)[1])
    assert over_plus["emulated"] == ["stage", "laser", "receiver"]
    # The number of pulses varies over PLUS, and with it energy and noise; the rest of the world is the same.
    assert over_plus["angle_deg"] == pytest.approx(simulated["angle_deg"], abs=0.3)
    assert over_plus["refused"] == 0
