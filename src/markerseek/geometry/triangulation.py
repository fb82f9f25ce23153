"""Points in space from their pixels in two cameras, with covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64, require_range
from markerseek.geometry.cameras import StereoCameras

MAX_REPROJECTION_PX = 3.0
"""Largest distance, in pixels, from a pixel to the projection of its point; more means two different spots."""

_STEPS = 20
"""Most Gauss-Newton steps; two or three are usual."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Triangulated:
    """Points from two cameras."""

    points_m: Float64[np.ndarray, "points 3"]
    """The points in the left camera's frame."""
    covariances_m2: Float64[np.ndarray, "points 3 3"]
    """Their covariances from the errors of the pixels."""
    by_pixel_m: Float64[np.ndarray, "points 3 4"]
    """Displacement of each point if left x, left y, right x or right y changes by one pixel."""


def triangulate(
    left_px: Float64[np.ndarray, "points 2"],
    right_px: Float64[np.ndarray, "points 2"],
    cameras: StereoCameras,
    *,
    sigma_px: float,
) -> Triangulated:
    """The points with projections nearest to the pixels: maximum likelihood for equal errors of all pixels.

    ``left_px``, ``right_px``: pixels in the left and the right image, row by row. ``sigma_px``: standard deviation of
    each pixel coordinate, of spot and calibration together.
    """
    require_range("sigma_px", sigma_px, low=0, high=100, unit="px", open_low=True)
    points_m = _midpoints(cameras.left.undistort(left_px), cameras.right.undistort(right_px), cameras)
    wanted = np.concatenate([left_px, right_px], axis=1)
    for _ in range(_STEPS):
        pixels, derivative = _projections(points_m, cameras)
        normal = np.einsum("nij,nik->njk", derivative, derivative)
        step = np.linalg.solve(normal, np.einsum("nij,ni->nj", derivative, wanted - pixels)[..., None])[..., 0]
        points_m = points_m + step
        if np.abs(step).max() < 1e-10:
            break
    pixels, derivative = _projections(points_m, cameras)
    reprojection_px = np.sqrt(np.sum((pixels - wanted) ** 2, axis=1) / 2)
    worst = int(np.argmax(reprojection_px))
    if not reprojection_px[worst] <= MAX_REPROJECTION_PX:
        raise ConfigError(
            f"point {worst + 1}: its two lines of sight miss each other by {reprojection_px[worst]:.1f} px, at most "
            f"{MAX_REPROJECTION_PX:g} px is allowed; the two images show different spots, or the calibration is wrong"
        )
    inverse = np.linalg.inv(np.einsum("nij,nik->njk", derivative, derivative))
    return Triangulated(
        points_m=points_m,
        covariances_m2=sigma_px**2 * inverse,
        by_pixel_m=inverse @ np.swapaxes(derivative, 1, 2),
    )


def _midpoints(
    left: Float64[np.ndarray, "points 2"], right: Float64[np.ndarray, "points 2"], cameras: StereoCameras
) -> Float64[np.ndarray, "points 3"]:
    """Middle of the shortest line between two lines of sight, the start of the iteration."""
    back = cameras.left_to_right.inverse()
    first = np.concatenate([left, np.ones((len(left), 1))], axis=1)
    second = np.concatenate([right, np.ones((len(right), 1))], axis=1) @ back.rotation.T
    # Depths a and b that bring a·first and origin + b·second nearest to each other.
    columns = np.stack([first, -second], axis=2)
    normal = np.einsum("nij,nik->njk", columns, columns)
    if not (np.linalg.det(normal) > 1e-12).all():
        raise ConfigError("the two lines of sight of a point are parallel: it would be infinitely far away")
    depths = np.linalg.solve(normal, np.einsum("nij,i->nj", columns, back.translation_m)[..., None])[..., 0]
    if not (depths > 0).all():
        number = int(np.flatnonzero(~(depths > 0).all(axis=1))[0]) + 1
        raise ConfigError(
            f"point {number}: its two lines of sight meet behind the cameras; check which image is the left one"
        )
    return np.asarray((depths[:, :1] * first + depths[:, 1:] * second + back.translation_m) / 2)


def _projections(
    points_m: Float64[np.ndarray, "points 3"], cameras: StereoCameras
) -> tuple[Float64[np.ndarray, "points 4"], Float64[np.ndarray, "points 4 3"]]:
    """Left and right pixels of points, and their derivatives by the point, in pixels per metre."""
    left, by_left = cameras.left.seen(points_m)
    right, by_right = cameras.right.seen(cameras.left_to_right.apply(points_m))
    by_point = [by_left, by_right @ cameras.left_to_right.rotation]
    return np.concatenate([left, right], axis=1), np.concatenate(by_point, axis=1)
