"""Poses of an OpenIGTLink server: each has the time of its message, and a wrong name is refused at once."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from markerseek.core import DeviceTimeoutError
from markerseek.drivers import SystemClock, open_poses, poses
from tests.unit.drivers.openigtlink_server import ImpoliteServer
from tests.waiting import wait_until

pytestmark = pytest.mark.real_time


def test_a_pose_has_the_time_of_its_message() -> None:
    with ImpoliteServer() as server:
        reader = open_poses(f"127.0.0.1:{server.port}/ProbeToProbeHome", SystemClock())
        with closing(reader):
            first = reader.read()
            assert first is not None
            assert first.matrix is not None
            turned = np.radians(server.angle_deg)
            assert first.matrix[:3, :3] @ [0, 0, 1] == pytest.approx([np.sin(turned), 0, np.cos(turned)], abs=1e-5)
            wait_until(server.sent.is_set)
            server.sent.clear()
            wait_until(server.sent.is_set)
            later = reader.read()
            assert later is not None
            assert first.stamp_s is not None
            assert later.stamp_s is not None
            assert 0 < later.stamp_s - first.stamp_s < 30


def test_a_wrong_name_is_refused_with_the_names_that_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poses, "CONNECT_S", 1.0)
    with ImpoliteServer() as server, pytest.raises(DeviceTimeoutError) as refusal:
        open_poses(f"127.0.0.1:{server.port}/Tip", SystemClock())
    assert str(refusal.value) == (
        "poses: no TRANSFORM 'Tip' came within 1 s; TRANSFORM came of 'ProbeToProbeHome', none of 'Tip'; correct the "
        "name, or let the server send it"
    )
