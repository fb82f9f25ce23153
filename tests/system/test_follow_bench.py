"""``markerseek follow`` on emulated devices: a tip of an OpenIGTLink server, then a point; no pulse is fired."""

from __future__ import annotations

import json
import signal
from contextlib import closing
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import structs

from markerseek.following import FollowStep, follow_record
from markerseek.guard.machine import AHEAD_DEG
from markerseek.registration import SessionRecord
from markerseek.rigs import bench_fingerprint, read_rig_file
from tests.emulated import emulation, ran
from tests.faults.followed_runs import CAMERA_TO_TRUS, registration
from tests.registration_sessions import BEGUN, registered
from tests.unit.drivers.openigtlink_server import ImpoliteServer

pytestmark = [pytest.mark.real_time, pytest.mark.long]
pytest.importorskip("serial", reason="needs the extra devices")

TIP_DEG = 9.0
POINT_DEG = -4.0
TURNED_DEG = ImpoliteServer.angle_deg


def camera_mm(angle_deg: float) -> np.ndarray:
    """A place 60 mm from the axis, in the plane of a probe at that angle, as the camera sees it."""
    angle = np.radians(angle_deg)
    return 1e3 * CAMERA_TO_TRUS.inverse().apply(0.06 * np.array([np.sin(angle), 0.0, np.cos(angle)]))


def test_a_tip_and_a_point_are_followed_in_the_dark(tmp_path: Path) -> None:
    known = tmp_path / "registration.json"
    known.write_bytes(msgspec.json.encode(registration(CAMERA_TO_TRUS).report))
    # The server reports a frame that is turned about y; the offset lies in it.
    turned = np.radians(TURNED_DEG)
    turn = np.array([[np.cos(turned), 0, np.sin(turned)], [0, 1, 0], [-np.sin(turned), 0, np.cos(turned)]])
    offset_mm = turn.T @ camera_mm(TIP_DEG)
    with ImpoliteServer() as server, emulation(tmp_path) as devices:
        given = ["follow", "--registration", known, "--rig", devices.rig, "--still-valid", "--arm", "--json"]
        tip = f"127.0.0.1:{server.port}/ProbeToProbeHome"
        followed = [
            ran(*given, "--tip", tip, "--tool-offset-mm", *offset_mm, "--seconds", 10),
            ran(*given, "--point", *camera_mm(POINT_DEG), "--seconds", 10),
        ]
        low_deg, high_deg, pulses = devices.end()
    for done, angle_deg in zip(followed, (TIP_DEG, POINT_DEG), strict=True):
        assert done.returncode == 0, done.stderr
        said = json.loads(done.stdout)
        assert said["last"]["word"] == "there", said
        assert said["last"]["target_deg"] == pytest.approx(angle_deg, abs=0.05)
        assert said["last"]["probe_deg"] == pytest.approx(angle_deg, abs=0.1)
    # The truth of the emulated probe, which is turned to both.
    assert high_deg == pytest.approx(TIP_DEG, abs=0.3)
    assert low_deg == pytest.approx(POINT_DEG, abs=0.3)
    assert pulses == 0


KILLED = """
import os, signal
from unittest import mock
from markerseek import following
steps = following.Follower.steps
def killed(follower):
    for step in steps(follower):
        if step.turning and step.probe_deg > 1.0:
            os.kill(os.getpid(), signal.SIGKILL)
        yield step
mock.patch.object(following.Follower, "steps", killed).start()
"""


def test_a_host_that_dies_while_the_probe_turns_leaves_it_in_the_dark_where_the_turn_ends(tmp_path: Path) -> None:
    known = tmp_path / "registration.json"
    known.write_bytes(msgspec.json.encode(registration(CAMERA_TO_TRUS).report))
    record = tmp_path / "follow.jsonl"
    with emulation(tmp_path) as devices:
        given = ["follow", "--registration", known, "--rig", devices.rig, "--still-valid", "--arm", "--json"]
        given += ["--point", *camera_mm(1.5 * AHEAD_DEG)]
        dead = ran(*given, before=KILLED)
        assert dead.returncode == -signal.SIGKILL, dead.stderr
        again = ran(*given, "--seconds", 15, "--record", record)
        _, _, pulses = devices.end()
    assert again.returncode == 0, again.stdout
    assert json.loads(again.stdout)["last"]["word"] == "there"
    lines = follow_record(record, is_over=lambda: True, wait=lambda: None)
    stood_deg = next(line.probe_deg for line in lines if isinstance(line, FollowStep))
    assert 1.0 < stood_deg < AHEAD_DEG + 0.3
    assert pulses == 0


def test_a_registration_whose_stage_was_turned_since_asks_for_a_spot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    plain = tmp_path / "registration.json"
    report = registration(CAMERA_TO_TRUS).report
    plain.write_bytes(msgspec.json.encode(report))
    with emulation(tmp_path) as devices:
        given = ["follow", "--rig", devices.rig, "--still-valid", "--arm", "--json", "--point", *camera_mm(POINT_DEG)]
        first = ran(*given, "--registration", plain, "--seconds", 5)
        assert first.returncode == 0, first.stderr
        (place,) = (tmp_path / "data" / "markerseek" / "stages").glob("*.json")
        since = json.loads(place.read_bytes())["since"]
        title = next(line for line in first.stderr.splitlines() if "KDC101" in line)
        done = {}
        for name, stage_since in (("same", since), ("other", "2026-01-01T00:00:00.000+00:00")):
            begun = structs.replace(
                BEGUN,
                rig=bench_fingerprint(read_rig_file(devices.rig)),
                description=title.strip(),
                stage_since=stage_since,
            )
            with closing(SessionRecord.create(tmp_path / name, begun)) as record:
                record.add(structs.replace(registered(4), report=report))
            done[name] = ran(*given, "--registration", tmp_path / name, "--seconds", 3)
        devices.end()
    assert done["same"].returncode == 0, done["same"].stderr
    assert done["other"].returncode == 2
    said = " ".join(done["other"].stderr.split())
    assert "does not hold until a spot has confirmed it: the stage did not stand where it was left" in said
    assert "--spot" in said
