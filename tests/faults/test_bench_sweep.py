"""A sweep over emulated devices from the command line: killed in mid-sweep, and one that finds the marker."""

from __future__ import annotations

import json
import os
import re
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from markerseek.core import SWEEP_READING_S, Asked, RecordError
from markerseek.drivers import LaserBox, LaserBoxSettings, SerialPort, SystemClock
from markerseek.drivers.kdc101 import AptLine
from markerseek.records.journal import read_journal
from markerseek.wire import apt
from tests.emulated import WORLD, Emulation, emulation, markerseek

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")
pytest.importorskip("serial", reason="needs the extra devices")

TRIES = 6
"""Sweeps that other programs may hold up: longer than `SWEEP_READING_S` or a lease, which rightly ends them."""

LEASE_LAPSED = "held up this computer for longer than the box's lease", "the supervisor released the devices"


@pytest.fixture(autouse=True)
def _urgent() -> Iterator[None]:
    """Real-time priority for what the test starts, where the user may."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    yield
    os.sched_setscheduler(0, *before)


def search(devices: Emulation, journal: Path) -> subprocess.Popen[str]:
    words = ("search", "--rig", devices.rig, "--sweep", "--arm", "--json", "--journal", journal)
    return subprocess.Popen(markerseek(*words), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def found(devices: Emulation, folder: Path) -> tuple[str, str]:
    """What a search prints that found the marker, after others that were held up."""
    for number in range(TRIES):
        process = search(devices, folder / f"{number}.journal")
        out, err = process.communicate()
        if process.returncode == 0:
            return out, err
        said = " ".join(err.split())
        # The time between two readings, in the words of the guard. No other end of a sweep is excused.
        late = re.search(r"the probe turned by \S+ deg in (\S+) s .* outside SweepPermit", said)
        assert any(each in said for each in LEASE_LAPSED) or (late and float(late[1]) > SWEEP_READING_S), err
    pytest.fail(f"each of {TRIES} sweeps was held up for longer than a lease; this test needs a core for itself")


@contextmanager
def stage_line(devices: Emulation) -> Iterator[AptLine]:
    """The stage's line, without the driver, which would write its parameters."""
    clock = SystemClock()
    with SerialPort(str(devices.rig.parent / "stage")) as port:
        yield AptLine(port=port, clock=clock, answer_s=0.2, age_s=2.0)


def speed_deg_s(line: AptLine) -> float:
    return line.ask(apt.ask(apt.VELOCITY), apt.VELOCITY, apt.Velocity).speed / apt.SPEED_WORD


def angle_deg(line: AptLine) -> float:
    return apt.degrees_of(line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status).position)


def pulses_seen(devices: Emulation) -> int:
    """Pulses that the laser box has fired since power-up, once it sends no more triggers."""
    with SerialPort(str(devices.rig.parent / "laser")) as port:
        return LaserBox(port=port, clock=SystemClock(), settings=LaserBoxSettings(port="", answer_s=5.0))._seen


def sweeps(journal: Path) -> bool:
    try:
        return any(isinstance(entry.event, Asked) for entry in read_journal(journal).entries)
    except RecordError:
        return False


@pytest.mark.long
def test_a_sweep_is_killed_and_the_next_one_finds_the_marker(tmp_path: Path) -> None:
    world = WORLD + "[receiver]\nsingle_pulses = true\n"
    with emulation(tmp_path, seed=3, text=world) as devices:
        usual = devices.rig.read_text()
        devices.rig.write_text(usual.replace('frames = "triggered"', 'frames = "fixed"'))
        process = search(devices, tmp_path / "refused.journal")
        out, err = process.communicate()
        assert process.returncode == 2, err
        assert "this rig cannot sweep: its SonixDAQ records a fixed number" in json.loads(out)["error"]
        devices.rig.write_text(usual)
        process = search(devices, tmp_path / "killed.journal")
        while process.poll() is None and not sweeps(tmp_path / "killed.journal"):
            time.sleep(0.02)
        # It turns to the nearer end in 3 s, and sweeps from there and back for 8 s.
        time.sleep(5.0)
        process.kill()
        process.communicate()
        with stage_line(devices) as line:
            seen_deg = angle_deg(line)
            time.sleep(1.0)
            # The supervisor has stopped it, within v²/2a; without one it would stand at the end of its permit.
            assert abs(angle_deg(line) - seen_deg) <= 25.0**2 / (2 * 25.0)
            assert -35.1 < angle_deg(line) < 35.1
        # Fewer than were permitted: the light ended with the process.
        seen = pulses_seen(devices)
        assert 0 < seen <= 120
        out, err = found(devices, tmp_path)
        with stage_line(devices) as line:
            assert speed_deg_s(line) == pytest.approx(25.0, rel=1e-3)
        low_deg, high_deg, pulses = devices.end()
    result = json.loads(out)
    assert (result["answer"], result["confirmed"], result["emulated"]) == ("found", True, ["stage", "laser"])
    assert result["angle_deg"] == pytest.approx(6.4, abs=0.3)
    said = " ".join(err.split())
    assert "sweeps from" in said
    assert "at most 20 frames a second" in said
    assert "s after each to read its frames" in said
    assert pulses >= seen + result["acquisitions"]
    assert -36.5 <= low_deg <= high_deg <= 36.5
