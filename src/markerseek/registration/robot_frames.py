"""A registration as the robot's programs take it: a base frame of the dVRK, and a static transform of ROS 2."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.ros import messages

DVRK_CAMERA = np.diag([-1.0, -1.0, 1.0, 1.0])
"""From the camera's frame of the dVRK to that of its images: x points to the left there, y up, and z along the view, so
that the two are half a turn about the line of sight apart (``camera_registration.py`` of dvrk_camera_registration)."""


def dvrk_base_frame(davinci_to_trus: Sequence[Sequence[float]]) -> str:
    """Return the base frame of an arm whose base is the dVRK's camera frame, in the probe's frame, as a block of JSON.

    ``davinci_to_trus``: as of `RegistrationReport`.
    """
    rows = (np.array(davinci_to_trus) @ DVRK_CAMERA).tolist()
    lines = ",\n".join(f"        [{', '.join(f'{value:.9f}' for value in row)}]" for row in rows)
    return f'"base-frame": {{\n    "reference-frame": "{messages.HOME}",\n    "transform": [\n{lines}\n    ]\n}}'


def static_transform_command(davinci_to_trus: Sequence[Sequence[float]], *, simulated: bool) -> str:
    """Return the command by which ROS 2 publishes the left camera in the home frame of the probe.

    ``davinci_to_trus``: as of `RegistrationReport`. ``simulated``: whether markers and camera were.
    """
    matrix = np.array(davinci_to_trus)
    place = zip(("x", "y", "z"), matrix[:3, 3].tolist(), strict=True)
    turn = zip(("qx", "qy", "qz", "qw"), Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist(), strict=True)
    camera = messages.SIMULATED_CAMERA if simulated else messages.CAMERA
    return (
        f"ros2 run tf2_ros static_transform_publisher {_options(place)} \\\n    {_options(turn)} \\\n"
        f"    --frame-id {messages.HOME} --child-frame-id {camera}"
    )


def _options(values: zip[tuple[str, float]]) -> str:
    return " ".join(f"--{name} {value:.9f}" for name, value in values)
