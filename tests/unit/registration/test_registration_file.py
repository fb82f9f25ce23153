"""A registration's file, and its transform as OpenIGTLink and ROS 2 send it: each maps a point to the same place."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from markerseek.core import RecordError
from markerseek.registration import KnownRegistration, PointPair, read_registration, register_pairs
from markerseek.ros import messages

CAMERA_M = np.array([[0.0, 0.0, 0.1], [0.02, 0.0, 0.11], [0.0, 0.03, 0.1], [0.02, 0.03, 0.13]])
ROTATION = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
TRUS_M = CAMERA_M @ ROTATION.T + (0.01, -0.02, 0.05)


def report() -> dict[str, Any]:
    """What ``register --json`` prints."""
    pairs = [
        PointPair(name=str(number), trus_m=trus_m, camera_m=camera_m)
        for number, (trus_m, camera_m) in enumerate(zip(TRUS_M, CAMERA_M, strict=True))
    ]
    return msgspec.to_builtins(register_pairs(pairs))


def read(folder: Path, values: object) -> KnownRegistration:
    path = folder / "registration.json"
    path.write_bytes(msgspec.json.encode(values))
    return read_registration(path)


def rotated(quaternion: SimpleNamespace, point: np.ndarray) -> np.ndarray:
    """A point turned by a quaternion, by its product: no matrix."""
    vector = np.array([quaternion.x, quaternion.y, quaternion.z])
    once = 2 * np.cross(vector, point)
    return point + quaternion.w * once + np.cross(vector, once)


@pytest.mark.parametrize(
    ("simulated", "child"), [(False, "davinci_camera_optical"), (True, "simulated_davinci_camera_optical")]
)
def test_ros_sends_it_in_metres_from_the_camera_to_the_home_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated: bool, child: str
) -> None:
    monkeypatch.setattr(messages, "kind", lambda _name: SimpleNamespace)
    held = read(tmp_path, report())
    message = messages.registered(held.davinci_to_trus, time_s=1.5, simulated=simulated)
    assert (message.header.frame_id, message.child_frame_id) == ("trus_home", child)
    place = message.transform.translation
    for camera_m, trus_m in zip(CAMERA_M, TRUS_M, strict=True):
        there_m = rotated(message.transform.rotation, camera_m) + np.array([place.x, place.y, place.z])
        np.testing.assert_allclose(there_m, trus_m, atol=1e-12)


SCALED = [[1.01, 0, 0, 0], [0, 1.01, 0, 0], [0, 0, 1.01, 0], [0, 0, 0, 1]]
MIRRORED = [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"registered": False, "reason": "FRE of 9.00 mm"}, r"was not accepted \(FRE of 9.00 mm\); register again"),
        ({"davinci_to_trus": SCALED}, "off orthonormal"),
        ({"davinci_to_trus": MIRRORED}, "mirrors space"),
        ({"davinci_to_trus": [[1, 0, 0]] * 4}, "4 rows of 4 numbers"),
        (
            {"davinci_to_trus": [[1, 0, 0, None], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
            "registration as JSON is expected, and this is none",
        ),
    ],
)
def test_what_is_no_accepted_rigid_transform_is_refused(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(RecordError, match=said):
        read(tmp_path, report() | changed)
