"""A rig with an emulated PLUS server as its receiver, from the command line, in real time."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.emulated import emulation

pytestmark = pytest.mark.real_time
for needed in ("serial", "pyigtl"):
    pytest.importorskip(needed, reason="needs the extras devices and igtl")

Shell = Callable[..., tuple[int, str, str]]


@pytest.mark.long
def test_a_search_finds_the_marker_and_says_that_the_receiver_is_emulated(shell: Shell, tmp_path: Path) -> None:
    search = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--no-journal")
    with emulation(tmp_path, "--receiver", "plus", seed=3, pace=1) as devices:
        assert "PLUS server: 127.0.0.1, port " in devices.said
        devices.rig.write_text(devices.rig.read_text().replace("quiet_s = 0.5", "quiet_s = 0.2"))
        code, out, err = shell("search", "--rig", devices.rig, "--arm", "--json", *search)
    assert code == 0, err
    over_plus = json.loads(out)
    simulated = json.loads(shell("search", "--rig", tmp_path / "world.toml", "--seed", 3, "--json", *search)[1])
    assert over_plus["emulated"] == ["stage", "laser", "receiver"]
    # The number of pulses varies over PLUS, and with it energy and noise; the rest of the world is the same.
    assert over_plus["angle_deg"] == pytest.approx(simulated["angle_deg"], abs=0.3)
    assert over_plus["refused"] == 0
