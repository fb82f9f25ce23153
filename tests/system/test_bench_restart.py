"""The real command, killed in mid-acquisition and started again at once on devices that keep running."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.emulated import emulation, markerseek

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")
pytest.importorskip("serial", reason="needs the extra devices")

SEARCH = ("--method", "posterior", "--single", "--json", "--no-journal", "--arm")


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_search_after_a_death_in_mid_acquisition_names_stale_files_and_finds_the_marker(
    tmp_path: Path, number: signal.Signals
) -> None:
    """Killed while a later acquisition is written, which then takes 1 s: its files land in the next search."""
    with emulation(tmp_path, seed=3, pace=0.1) as devices:
        rig, daq = devices.rig, devices.folder / "daq"
        first = subprocess.Popen(markerseek("search", "--rig", rig, *SEARCH), stderr=subprocess.DEVNULL)
        # the first acquisition is complete, and the second begins to be written
        watched = daq / "CH000.daq"
        wait_for((daq / "CH127.daq").exists, first)
        before = watched.stat().st_ino
        wait_for(lambda: watched.stat().st_ino != before, first)
        first.send_signal(number)
        first.communicate(timeout=60)
        ended = subprocess.run(
            markerseek("search", "--rig", rig, *SEARCH), capture_output=True, text=True, timeout=240, check=False
        )
    result = json.loads(ended.stdout)
    assert ended.returncode in (0, 3), ended.stderr
    assert abs(result["angle_deg"] - 6.4) < 0.5
    assert result["refused"] == ended.stderr.count("refused at ")
    # an interpreter takes longer to begin than a second on a busy machine: then nothing lands any more
    assert ended.stderr.count("stale files") == result["refused"] <= 1


def wait_for(condition, process: subprocess.Popen[bytes]) -> None:  # type: ignore[no-untyped-def]
    while not condition():
        assert process.poll() is None
        time.sleep(0.005)
