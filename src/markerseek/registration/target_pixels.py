"""The target of a registration where the cameras of the endoscope see it, with its expected error in pixels."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from markerseek.core import ConfigError, Float64
from markerseek.registration.report import RegistrationReport, davinci_to_probe_home
from markerseek.registration.stereo_files import StereoSettings

Pixel: TypeAlias = tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"]]
"""Column and row in an image, and their covariance in square pixels; they may be outside of the image."""


def target_pixels(report: RegistrationReport, *, stereo: StereoSettings) -> tuple[Pixel, Pixel]:
    """Return where the left and the right camera see the target of a registration.

    Raises `ConfigError` if the registration is not accepted, or the target is behind a camera.
    """
    if report.davinci_to_trus is None:
        raise ConfigError("the points do not fit, so that nobody knows where the target is in the images")
    place_m, covariance_m2 = np.array(report.target_trus_m), np.array(report.target_covariance_m2)
    seen = []
    way = davinci_to_probe_home(report.davinci_to_trus).inverse(), stereo.cameras.left_to_right
    for name, camera, step in zip(("left", "right"), (stereo.left, stereo.right), way, strict=True):
        place_m, covariance_m2 = step.apply(place_m), step.rotation @ covariance_m2 @ step.rotation.T
        if not place_m[2] > 0:
            raise ConfigError(f"the target is behind the {name} camera; name another by --target-mm")
        seen.append((camera.project(place_m[None])[0], camera.project_covariance(place_m, covariance_m2)))
    return seen[0], seen[1]
