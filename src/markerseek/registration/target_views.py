"""The target of a registration where the cameras of the endoscope see it, with its expected error in pixels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from markerseek.core import ConfigError, Float64, UInt8
from markerseek.geometry import Camera
from markerseek.records import read_camera_images
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
    if report.davinci_to_trus is None:
        raise ConfigError("the points do not fit, so that nobody knows where the target is in the images")
    to_left = davinci_to_probe_home(report.davinci_to_trus).inverse()
    to_right = stereo.cameras.left_to_right
    target_m = to_left.apply(np.array(report.target_trus_m))
    covariance_m2 = to_left.rotation @ np.array(report.target_covariance_m2) @ to_left.rotation.T
    name = report.points[0].name
    return (
        _view("left", left / name, stereo.left, target_m, covariance_m2),
        _view(
            "right",
            right / name,
            stereo.right,
            to_right.apply(target_m),
            to_right.rotation @ covariance_m2 @ to_right.rotation.T,
        ),
    )


def _view(
    camera: Literal["left", "right"],
    folder: Path,
    seen_by: Camera,
    target_m: Float64[np.ndarray, " 3"],
    covariance_m2: Float64[np.ndarray, "3 3"],
) -> TargetView:
    if not target_m[2] > 0:
        raise ConfigError(f"the target is behind the {camera} camera; name another by --target-mm")
    return TargetView(
        camera=camera,
        image=read_camera_images(folder)[0],
        pixel=seen_by.project(target_m[None])[0],
        covariance_px2=seen_by.project_covariance(target_m, covariance_m2),
    )
