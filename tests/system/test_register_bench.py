"""A whole registration on emulated devices from the command line: bytes, image folders, real drivers, real time."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from tests.emulated import WORLD, emulation, markerseek

pytestmark = [pytest.mark.real_time, pytest.mark.long]
pytest.importorskip("serial", reason="needs the extra devices")


@pytest.mark.parametrize("sweep", [False, True])
def test_who_lights_the_places_that_are_asked_for_registers_the_emulated_devices(tmp_path: Path, sweep: bool) -> None:
    world = WORLD.replace("[marker]\nangle_deg = 6.4\n", "")
    with emulation(tmp_path, "--endoscope", seed=3, text=world) as devices:
        bench = devices.folder
        kept = tmp_path / "session"
        (proposed,) = re.findall(r"^try: markerseek register (.*)$", devices.said, re.MULTILINE)
        options = ["--record", kept, "--markers", 3, "--wait-s", 60, *(["--sweep"] if sweep else [])]
        command = markerseek("register", *shlex.split(proposed), *options, "--trace", bench / "lines.txt")
        said = []
        with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
            assert process.stderr is not None
            assert devices.process.stdin is not None
            for line in process.stderr:
                said.append(line)
                if place := re.search(r"light the next spot near \((\d+), (\d+)\) px", line):
                    devices.process.stdin.write(f"{place[1]} {place[2]}\n")
                    devices.process.stdin.flush()
                if "press Enter once the spot is set" in line:
                    # As a pedal does, or the page. Asked first, the session forgets what was said before.
                    time.sleep(1)
                    (kept / "spot-is-set").touch()
        assert process.returncode == 0, "".join(said)
        assert f"images: folders {bench / 'left'} (left) and {bench / 'right'} (right)" in "".join(said).replace(
            "\n", " "
        )
        lines = (bench / "lines.txt").read_text(encoding="utf-8")
        for word in ("stage > ", "stage < ", "laser > ", "left image ", "right image "):
            assert word in lines, word
        truth = devices.ended().split("davinci_to_trus is")[1]
    true = np.array([[float(value) for value in row.split()] for row in truth.strip().splitlines()[:4]])
    report = json.loads((kept / "registration.json").read_bytes())
    target_m = np.array([0.0, 0.0, 0.04, 1.0])
    error_m = np.linalg.norm((np.array(report["davinci_to_trus"]) @ np.linalg.inv(true) @ target_m - target_m)[:3])
    assert error_m < 2 * report["tre95_m"] < 8e-3
    # A rig of devices writes nothing but the session's folder, and where the stage was left.
    assert {path.name for path in tmp_path.iterdir()} == {"bench", "data", "session", "world.toml"}
    assert [path.parent.name for path in (tmp_path / "data").rglob("*") if path.is_file()] == ["stages"]
