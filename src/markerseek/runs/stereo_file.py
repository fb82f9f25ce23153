"""Reads the calibration of a stereo endoscope from a TOML file, in the conventions of OpenCV's ``stereoCalibrate``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, require_range
from markerseek.files import read_toml, settings_from
from markerseek.geometry import Camera, RigidTransform, StereoCameras


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoSettings:
    """Keys of the file."""

    left: Camera
    right: Camera
    rotation_vector: tuple[float, float, float]
    """Rotation from the left camera's frame to the right one's as ``cv2.Rodrigues`` gives it, in radians."""
    translation_m: tuple[float, float, float]
    """Translation from the left camera's frame to the right one's, in metres (OpenCV gives it in the unit of the
    calibration target)."""
    calibration_sigma_px: float
    """Standard deviation of the error of the calibration: the reprojection error of points that were not used for
    it."""

    def __post_init__(self) -> None:
        require_range(
            "calibration_sigma_px",
            self.calibration_sigma_px,
            low=0,
            high=100,
            unit="px",
            open_low=True,
            cure="0.2 is usual",
        )
        if not np.isfinite(self.rotation_vector).all():
            raise ConfigError(f"rotation_vector is {self.rotation_vector}, it must be three finite numbers")

    @property
    def cameras(self) -> StereoCameras:
        """The pair of cameras."""
        return StereoCameras(
            left=self.left,
            right=self.right,
            left_to_right=RigidTransform(
                source="Left",
                target="Right",
                rotation=Rotation.from_rotvec(self.rotation_vector).as_matrix(),
                translation_m=np.array(self.translation_m, dtype=float),
            ),
        )


def read_stereo(path: Path) -> StereoSettings:
    """Calibration of a stereo endoscope.

    ``path``: TOML file; ``examples/stereo.toml`` shows all keys.
    """
    table = read_toml(path, what="stereo calibration")
    try:
        settings = settings_from(table, StereoSettings)
        # The base is checked with the pair.
        settings.cameras  # noqa: B018
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem
    return settings
