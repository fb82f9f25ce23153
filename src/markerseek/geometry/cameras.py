"""Cameras: pinhole with the lens distortion of OpenCV, alone and as a stereo pair.

Axes are those of OpenCV: x to the right in the image, y down, z along the view; a pixel's centre has whole coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64, require_range
from markerseek.geometry.transform import RigidTransform

_STEPS = 50
"""Most Newton steps for the inverse of the distortion; some five are usual."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Intrinsics of one camera."""

    focal_px: tuple[float, float]
    """Focal lengths along x and y."""
    centre_px: tuple[float, float]
    """Principal point."""
    size_px: tuple[int, int]
    """Width and height of the image."""
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """Coefficients (k1, k2, p1, p2, k3) in the order of OpenCV: radial, tangential, radial."""

    def __post_init__(self) -> None:
        for name, values, low, high in (
            ("size_px", self.size_px, 16, 65_536),
            ("focal_px", self.focal_px, 1, 1e6),
            ("centre_px", self.centre_px, -1e6, 1e6),
            ("distortion", self.distortion, -100, 100),
        ):
            for value in values:
                require_range(f"camera: {name}", value, low=low, high=high, unit="px" if name != "distortion" else "")

    def project(self, points_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 2"]:
        """Pixels of points in the camera's frame."""
        if not (points_m[:, 2] > 0).all():
            number = int(np.flatnonzero(~(points_m[:, 2] > 0))[0]) + 1
            raise ConfigError(f"point {number} is at z = {points_m[number - 1, 2]:.4g} m, behind the camera")
        return self.seen(points_m)[0]

    def seen(
        self, points_m: Float64[np.ndarray, "points 3"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2 3"]]:
        """Pixels of points in the camera's frame, also behind it, and their derivatives by the point, in px/m."""
        direct = points_m[:, :2] / points_m[:, 2:]
        distorted, bend = self.distort(direct)
        # d(x/z, y/z) by (x, y, z): [1/z, 0, −x/z²] and [0, 1/z, −y/z²].
        perspective = np.zeros((len(points_m), 2, 3))
        perspective[:, 0, 0] = perspective[:, 1, 1] = 1 / points_m[:, 2]
        perspective[:, :, 2] = -direct / points_m[:, 2:]
        return distorted * self.focal_px + self.centre_px, np.array(self.focal_px)[:, None] * (bend @ perspective)

    def project_covariance(
        self, point_m: Float64[np.ndarray, " 3"], covariance_m2: Float64[np.ndarray, "3 3"]
    ) -> Float64[np.ndarray, "2 2"]:
        """Covariance of the pixel of a point in the camera's frame, to first order, in px²."""
        slope = self.seen(point_m[None])[1][0]
        return np.asarray(slope @ covariance_m2 @ slope.T)

    def distort(
        self, direct: Float64[np.ndarray, "points 2"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2 2"]]:
        """Distorted normalised coordinates (x/z, y/z) of undistorted ones, and their derivatives."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = direct.T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)
        both = np.stack(
            [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
            axis=1,
        )
        derivative = np.empty((len(direct), 2, 2))
        derivative[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        derivative[:, 0, 1] = derivative[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        derivative[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        return both, derivative

    def undistort(self, pixels: Float64[np.ndarray, "points 2"]) -> Float64[np.ndarray, "points 2"]:
        """Undistorted normalised coordinates (x/z, y/z) of pixels, by Newton's method."""
        inside = ((pixels >= -0.5) & (pixels <= np.array(self.size_px) - 0.5)).all(axis=1)
        if not inside.all():
            number = int(np.flatnonzero(~inside)[0])
            x, y = pixels[number]
            raise ConfigError(
                f"pixel {number + 1} is ({x:.1f}, {y:.1f}), outside the image of {self.size_px[0]} x {self.size_px[1]}"
            )
        wanted = (pixels - self.centre_px) / self.focal_px
        direct = wanted.copy()
        for _ in range(_STEPS):
            found, derivative = self.distort(direct)
            step = np.linalg.solve(derivative, (wanted - found)[..., None])[..., 0]
            direct += step
            if np.abs(step).max() < 1e-12:
                return np.asarray(direct)
        raise ConfigError(
            f"camera: the distortion {self.distortion} cannot be inverted at the pixels given; calibrate the camera "
            "with targets up to the corners of the image"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StereoCameras:
    """Two cameras; the frame of the pair is that of the left one."""

    left: Camera
    right: Camera
    left_to_right: RigidTransform
    """Transform of the left camera's frame to the right one's: its translation is minus the base for parallel
    cameras."""

    def __post_init__(self) -> None:
        require_range("cameras: base", self.base_m, low=1e-4, high=1.0, unit="m", cure="give the transform in metres")

    @property
    def base_m(self) -> float:
        """Distance between the two cameras in metres."""
        return float(np.linalg.norm(self.left_to_right.translation_m))

    def project(
        self, points_m: Float64[np.ndarray, "points 3"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2"]]:
        """Pixels in the left and the right image of points in the left camera's frame."""
        return self.left.project(points_m), self.right.project(self.left_to_right.apply(points_m))
