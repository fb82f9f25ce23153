"""``markerseek follow`` on emulated devices: a tip of an OpenIGTLink server, then a point; no pulse is fired."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tests.emulated import emulation, ran
from tests.faults.followed_runs import CAMERA_TO_TRUS, registration
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
