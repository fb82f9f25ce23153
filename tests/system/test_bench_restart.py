"""The real command, killed in mid-acquisition and started again at once on devices that keep running."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")
pytest.importorskip("thorlabs_apt_protocol", reason="needs the extra devices")

WORLD = """kind = "simulated"
[marker]
angle_deg = 6.4
[stage]
speed_deg_s = 25.0
acceleration_deg_s2 = 25.0
"""
SEARCH = ("--method", "posterior", "--json", "--no-journal", "--arm")


def markerseek(*words: object) -> list[str]:
    return [sys.executable, "-c", "from markerseek.cli import main; main()", *map(str, words)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_search_after_a_death_in_mid_acquisition_names_stale_files_and_finds_the_marker(
    tmp_path: Path, number: signal.Signals
) -> None:
    """Killed while a later acquisition is written, which then takes 1 s: its files land in the next search."""
    (tmp_path / "world.toml").write_text(WORLD)
    bench, daq = tmp_path / "bench", tmp_path / "bench" / "daq"
    emulator = subprocess.Popen(
        markerseek("emulate", "bench", "--dir", bench, "--rig", tmp_path / "world.toml", "--seed", 3, "--pace", 0.1),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert emulator.stdout is not None
        next(line for line in emulator.stdout if "Ctrl-C ends it" in line)
        rig = bench / "rig.toml"
        first = subprocess.Popen(markerseek("search", "--rig", rig, *SEARCH), stderr=subprocess.DEVNULL)
        # the first acquisition is complete, and the second begins to be written
        watched = daq / "CH000.daq"
        wait_for((daq / "CH127.daq").exists, first)
        before = watched.stat().st_ino
        wait_for(lambda: watched.stat().st_ino != before, first)
        first.send_signal(number)
        first.communicate(timeout=20)
        ended = subprocess.run(
            markerseek("search", "--rig", rig, *SEARCH), capture_output=True, text=True, timeout=240, check=False
        )
    finally:
        emulator.kill()
        emulator.communicate()
    result = json.loads(ended.stdout)
    assert ended.returncode in (0, 3), ended.stderr
    assert abs(result["angle_deg"] - 6.4) < 0.5
    assert result["refused"] == ended.stderr.count("refused:")
    # an interpreter takes longer to begin than a second on a busy machine: then nothing lands any more
    assert ended.stderr.count("stale files") == result["refused"] <= 1


def wait_for(condition, process: subprocess.Popen[bytes]) -> None:  # type: ignore[no-untyped-def]
    while not condition():
        assert process.poll() is None
        time.sleep(0.005)
