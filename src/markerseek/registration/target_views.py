"""The target of a registration where the cameras of the endoscope see it, with its expected error in pixels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from markerseek.core import ConfigError, Float64, UInt8
from markerseek.geometry import Camera
from markerseek.registration.points import read_camera_images
from markerseek.registration.report import RegistrationReport, davinci_to_probe_home
from markerseek.registration.stereo_files import StereoSettings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetView:
    """A target in the image of one camera."""

    camera: Literal["left", "right"]
    image: UInt8[np.ndarray, "rows columns"]
    pixel: Float64[np.ndarray, " 2"]
    """Column and row at which it is expected; they may be outside of the image."""
    covariance_px2: Float64[np.ndarray, "2 2"]
    """Covariance of that pixel, by the expected error of the registration there."""


def target_views(
    report: RegistrationReport, left: Path, right: Path, *, stereo: StereoSettings
) -> tuple[TargetView, TargetView]:
    """Return the target of a registration in an image of each camera.

    ``left``, ``right``: folders as of `spot_pairs`; the images are the first of the first point. ``stereo``:
    calibration of the cameras. Raises `ConfigError` if the registration is not accepted, or the target is behind a
    camera.
    """
    name = report.points[0].name
    seen = target_pixels(report, stereo=stereo)
    left_image, right_image = (read_camera_images(folder / name)[0] for folder in (left, right))
    return (
        TargetView(camera="left", image=left_image, pixel=seen[0][0], covariance_px2=seen[0][1]),
        TargetView(camera="right", image=right_image, pixel=seen[1][0], covariance_px2=seen[1][1]),
    )


Pixel: TypeAlias = tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"]]
"""Column and row in an image, and their covariance in square pixels."""


def target_pixels(report: RegistrationReport, *, stereo: StereoSettings) -> tuple[Pixel, Pixel]:
    """Return where the left and the right camera see the target of a registration; errors as of `target_views`."""
    if report.davinci_to_trus is None:
        raise ConfigError("the points do not fit, so that nobody knows where the target is in the images")
    to_left = davinci_to_probe_home(report.davinci_to_trus).inverse()
    to_right = stereo.cameras.left_to_right
    target_m = to_left.apply(np.array(report.target_trus_m))
    covariance_m2 = to_left.rotation @ np.array(report.target_covariance_m2) @ to_left.rotation.T
    turned_m2 = to_right.rotation @ covariance_m2 @ to_right.rotation.T
    return (
        _seen("left", stereo.left, target_m, covariance_m2),
        _seen("right", stereo.right, to_right.apply(target_m), turned_m2),
    )


def _seen(
    name: str, camera: Camera, target_m: Float64[np.ndarray, " 3"], covariance_m2: Float64[np.ndarray, "3 3"]
) -> Pixel:
    if not target_m[2] > 0:
        raise ConfigError(f"the target is behind the {name} camera; name another by --target-mm")
    return camera.project(target_m[None])[0], camera.project_covariance(target_m, covariance_m2)
