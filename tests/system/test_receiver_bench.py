"""A rig whose receiver is an emulated PLUS server or Vantage, or the real sender of a Vantage in GNU Octave."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.emulated import emulation
from tests.octave import NO_OCTAVE, has_octave_sockets

pytestmark = pytest.mark.real_time
for needed in ("serial", "pyigtl"):
    pytest.importorskip(needed, reason="needs the extras devices and igtl")

Shell = Callable[..., tuple[int, str, str]]
SEARCH = ("--method", "weighted-average", "--as-published", "--acquisitions", "8", "--no-journal", "--json")


@pytest.mark.long
@pytest.mark.parametrize(
    ("receiver", "by_octave"),
    [
        ("plus", False),
        ("vantage", False),
        pytest.param("vantage", True, marks=pytest.mark.skipif(not has_octave_sockets(), reason=NO_OCTAVE)),
    ],
)
def test_a_search_over_a_receiver_finds_the_marker(
    shell: Shell, tmp_path: Path, receiver: str, by_octave: bool
) -> None:
    with emulation(tmp_path, "--receiver", receiver, seed=3, pace=1) as devices:
        rig = devices.rig.read_text().replace("quiet_s = 0.5", "quiet_s = 0.2")
        said = "PLUS server: 127.0.0.1" if receiver == "plus" else "Vantage: sends to 127.0.0.1"
        emulated_port = re.search(rf"{said}, port (\d+)", devices.said)[1]
        octave = None
        if by_octave:
            with socket.create_server(("127.0.0.1", 0)) as taken:
                port = taken.getsockname()[1]
            rig = rig.replace(f"port = {emulated_port}", f"port = {port}")
            script = Path(__file__).with_name("vantage_sequence.m")
            sender = Path(__file__).parents[2] / "matlab"
            octave = subprocess.Popen(
                ["octave-cli", "--quiet", "--no-init-file", script],
                env=os.environ | {"VANTAGE": f"{emulated_port},{port},{sender}"},
            )
        devices.rig.write_text(rig)
        try:
            code, out, err = shell("search", "--rig", devices.rig, "--arm", *SEARCH)
        finally:
            if octave is not None:
                octave.kill()
                octave.wait()
    assert code == 0, err
    found = json.loads(out)
    simulated = json.loads(shell("search", "--rig", tmp_path / "world.toml", "--seed", 3, *SEARCH)[1])
    # What goes through the real sender comes as from a Vantage.
    assert found["emulated"] == ["stage", "laser", *([] if by_octave else ["receiver"])]
    # The number of pulses varies, and with it energy and noise; the rest of the world is the same.
    assert found["angle_deg"] == pytest.approx(simulated["angle_deg"], abs=0.3)
    assert found["refused"] == 0
