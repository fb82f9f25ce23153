"""A registration for the dVRK and for ROS 2, read again as these programs read it."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.registration.robot_frames import dvrk_base_frame, static_transform_command

POINTS_M = np.array([[0.0, 0.0, 0.1], [0.03, -0.01, 0.12], [-0.02, 0.02, 0.09]])
"""Points in the camera's frame of the images."""


def matrices() -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    found = []
    for rotation in (*Rotation.random(5, random_state=rng), Rotation.from_rotvec([np.pi, 0, 0])):
        matrix = np.eye(4)
        matrix[:3, :3] = rotation.as_matrix()
        matrix[:3, 3] = 0.2 * rng.standard_normal(3)
        found.append(matrix)
    return found


def as_tf2_rotates(x: float, y: float, z: float, w: float, points_m: np.ndarray) -> np.ndarray:
    """The points turned by a quaternion: p + 2 q × (q × p + w p), written out from its definition."""
    axis = np.array([x, y, z])
    return points_m + 2 * np.cross(axis, np.cross(axis, points_m) + w * points_m)


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("matrix", matrices())
def test_ros_puts_a_point_of_the_camera_where_the_registration_does(matrix: np.ndarray, simulated: bool) -> None:
    words = shlex.split(static_transform_command(matrix.tolist(), simulated=simulated).replace("\\\n", " "))
    assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    given = dict(zip(words[4::2], words[5::2], strict=True))
    camera = "simulated_davinci_camera_optical" if simulated else "davinci_camera_optical"
    assert (given.pop("--frame-id"), given.pop("--child-frame-id")) == ("trus_home", camera)
    values = {name: float(text) for name, text in given.items()}
    assert set(values) == {f"--{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw")}
    turned_m = as_tf2_rotates(*(values[f"--q{axis}"] for axis in "xyzw"), POINTS_M)
    there_m = turned_m + np.array([values["--x"], values["--y"], values["--z"]])
    expected_m = POINTS_M @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(there_m, expected_m, atol=1e-8)


@pytest.mark.parametrize("matrix", matrices())
def test_the_dvrk_puts_a_point_of_its_camera_where_the_registration_does(matrix: np.ndarray) -> None:
    frame = json.loads("{" + dvrk_base_frame(matrix.tolist()) + "}")["base-frame"]
    assert frame["reference-frame"] == "trus_home"
    # Its camera looks along z, too, with x to the left and y up.
    of_dvrk_m = POINTS_M * [-1, -1, 1]
    transform = np.array(frame["transform"])
    there_m = of_dvrk_m @ transform[:3, :3].T + transform[:3, 3]
    np.testing.assert_allclose(there_m, POINTS_M @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-8)
    # What is pasted is a rigid transform, of a right-handed frame.
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(transform[3], [0, 0, 0, 1])
