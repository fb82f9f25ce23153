"""Errors that all points of a registration share: how far one standard deviation of each displaces a point.

No residual shows them as noise, and no sigma of a point holds them, so that they are unknowns of the registration, each
with a Gaussian prior of mean 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from markerseek.core import Float64, SpotToSource
from markerseek.geometry import StereoCameras, Triangulated, triangulate

_SOUND_SPEED = 0.01
_FACE_RADIUS_M = 0.2e-3
_ANGLE_ZERO_DEG = 0.1
FOCAL_LENGTH = 0.005
BASE_LENGTH = 0.005
"""Standard deviations of the sound speed (relative), of the distance of the array's face from the axis (metres), of the
angle at which the stage finds its zero again (degrees), of the focal length and of the distance between the cameras
(both relative)."""

USUAL_FACE_M = 10e-3
"""Distance of the array's face from the axis, in metres, from which depth counts. A marker's position does not say it;
2 mm more change the effect of 1 % of sound speed by 0.02 mm, a tenth of that of `_FACE_RADIUS_M`."""


class SharedError(NamedTuple):
    """An error that all points share: its name, its standard deviation in a unit, and words for it."""

    name: str
    sigma: float
    unit: str
    large: str
    """Word for a value that was assumed too large: "too long"."""
    small: str
    cure: str
    """What to do if it is larger than assumed; empty: nothing is in doubt."""


_CALIBRATE_CAMERAS = "calibrate the endoscope again, at the focus that is used"
_CALIBRATE_PROBE = "calibrate the probe again"

TRUS_ERRORS = (
    SharedError("sound speed", 100 * _SOUND_SPEED, "%", "too high", "too low", "measure the sound speed of the tissue"),
    SharedError("face radius", 1e3 * _FACE_RADIUS_M, "mm", "too long", "too short", _CALIBRATE_PROBE),
    SharedError("zero of the angle", _ANGLE_ZERO_DEG, "deg", "too large", "too small", _CALIBRATE_PROBE),
)
"""The errors of `trus_shared_m`, in its order."""

FOCAL_ERROR = SharedError("focal length", 100 * FOCAL_LENGTH, "%", "too long", "too short", _CALIBRATE_CAMERAS)
"""The first error of `camera_shared_m`; four shifts of the images follow where the pixels are known."""

BASE_ERROR = SharedError("base", 100 * BASE_LENGTH, "%", "too long", "too short", _CALIBRATE_CAMERAS)


def depth_error(spot: SpotToSource) -> SharedError:
    """Return the error of the depth at which light is absorbed."""
    return SharedError("depth of the source", 1e3 * spot.depth_sigma_m, "mm", "too deep", "not deep enough", "")


def vergence_error(depth_share: float) -> SharedError:
    """Return the error of the angle between the cameras, by its effect on a distance from them, relative to it."""
    return SharedError("vergence", 100 * depth_share, "% of depth", "too far", "too near", _CALIBRATE_CAMERAS)


def source_shared_m(
    camera_m: Float64[np.ndarray, "points 3"],
    camera_shared: Float64[np.ndarray, "points 3 errors"] | None,
    spot: SpotToSource,
) -> Float64[np.ndarray, "points 3 all_errors"]:
    """Return the displacements of the sources below spots: those of `camera_shared_m`, base, and depth.

    ``camera_shared``: as of `camera_shared_m`; None: of points without known pixels.
    """
    known = focal_shared_m(camera_m) if camera_shared is None else camera_shared
    # The base scales all coordinates of a stereo pair.
    base_m = BASE_LENGTH * camera_m
    depth_m = spot.depth_sigma_m * _along_sight(camera_m)
    return np.concatenate([known, base_m[:, :, None], depth_m[:, :, None]], axis=2)


def sources_m(camera_m: Float64[np.ndarray, "points 3"], spot: SpotToSource) -> Float64[np.ndarray, "points 3"]:
    """Return where the light of visible spots is absorbed: below them, along the line of sight."""
    return np.asarray(camera_m + spot.depth_m * _along_sight(camera_m))


def _along_sight(camera_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3"]:
    return np.asarray(camera_m / np.maximum(np.linalg.norm(camera_m, axis=1), 1e-9)[:, None])


def shared_directions(
    camera_m: Float64[np.ndarray, "points 3"],
    camera_shared: Float64[np.ndarray, "points 3 errors"] | None,
    spot: SpotToSource,
    *,
    motions: int = 0,
) -> list[tuple[SharedError, Float64[np.ndarray, " errors"]]]:
    """Return the errors that a registration reports, and the place of each among all shared errors.

    ``motions``: number of errors of motions of the endoscope, which follow those of the camera. Each is a unit vector.
    Shifts of the images count by their vergence: the one combination that changes distances.
    """
    shifts = 0 if camera_shared is None else camera_shared.shape[2] - 1
    count = 1 + shifts + 2 + motions + len(TRUS_ERRORS)
    axes = np.eye(count)
    found = [(FOCAL_ERROR, axes[0])]
    if camera_shared is not None and shifts > 0:
        effect = np.mean(camera_shared[:, 2, 1:] / camera_m[:, 2:], axis=0)
        share = float(np.linalg.norm(effect))
        if share > 0:
            found.append((vergence_error(share), np.concatenate([[0.0], effect / share, np.zeros(count - 1 - shifts)])))
    found.append((BASE_ERROR, axes[1 + shifts]))
    if spot.depth_sigma_m > 0:
        found.append((depth_error(spot), axes[2 + shifts]))
    return found + [(error, axes[3 + shifts + motions + number]) for number, error in enumerate(TRUS_ERRORS)]


def trus_shared_m(trus_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3 3"]:
    """Return the displacement of points in the TRUS frame, in metres, per +1 sigma of each of `TRUS_ERRORS`."""
    x, _, z = trus_m.T
    radius_m = np.maximum(np.hypot(x, z), 1e-9)
    away = np.stack([x / radius_m, np.zeros_like(x), z / radius_m], axis=1)
    turned_m = math.radians(_ANGLE_ZERO_DEG) * np.stack([z, np.zeros_like(x), -x], axis=1)
    deeper_m = _SOUND_SPEED * (radius_m - USUAL_FACE_M)
    return np.stack([deeper_m[:, None] * away, _FACE_RADIUS_M * away, turned_m], axis=2)


def camera_shared_m(
    seen: Triangulated,
    left_px: Float64[np.ndarray, "points 2"],
    right_px: Float64[np.ndarray, "points 2"],
    cameras: StereoCameras,
    *,
    calibration_sigma_px: float,
) -> Float64[np.ndarray, "points 3 5"]:
    """Return the displacements of triangulated points in the camera's frame, in metres.

    First where the focal length was assumed too large, then where left x, left y, right x, right y are shifted.
    """
    # With a longer focal length, the same pixels are as near to the principal point as others are with the right one.
    from_centre = np.concatenate([left_px - cameras.left.centre_px, right_px - cameras.right.centre_px], axis=1)
    focal_m = -FOCAL_LENGTH * np.einsum("nij,nj->ni", seen.by_pixel_m, from_centre)
    return np.concatenate([focal_m[:, :, None], calibration_sigma_px * seen.by_pixel_m], axis=2)


def seen_point(
    left_px: Float64[np.ndarray, " 2"],
    right_px: Float64[np.ndarray, " 2"],
    cameras: StereoCameras,
    *,
    spot_px: float,
    calibration_px: float,
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"], Float64[np.ndarray, "3 5"]]:
    """Return a point from its two pixels, its covariance, and its displacements by shared errors.

    ``spot_px``, ``calibration_px``: standard deviations of the spot and of the calibration, in pixels.
    """
    left = left_px[None]
    right = right_px[None]
    seen = triangulate(left, right, cameras, sigma_px=math.hypot(spot_px, calibration_px))
    shared = camera_shared_m(seen, left, right, cameras, calibration_sigma_px=calibration_px)
    return seen.points_m[0], seen.covariances_m2[0], shared[0]


def focal_shared_m(camera_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3 1"]:
    """Return the displacements without known pixels: the focal length alone, which stretches a pair's depth."""
    return np.asarray((FOCAL_LENGTH * camera_m * [0, 0, 1])[:, :, None])
