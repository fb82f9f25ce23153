"""Cameras: pinhole with the lens distortion of OpenCV, alone and as a stereo pair, which triangulates points.

Axes are those of OpenCV: x to the right in the image, y down, z along the view; a pixel's centre has whole coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np

from markerseek.core import ConfigError, Float64, require_range
from markerseek.geometry.transform import RigidTransform

_UNDISTORT_STEPS = 50
"""Most Newton steps for the inverse of the distortion; some five are usual."""

MAX_REPROJECTION_PX = 3.0
"""Largest distance, in pixels, from a pixel to the projection of its point; more means two different spots."""

_TRIANGULATION_STEPS = 20
"""Most Gauss-Newton steps of a triangulation; two or three are usual."""


class Camera(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
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

    def size_problem(self, pixels: np.ndarray) -> str:
        """Say how an image differs from the calibration in its size, and what to do; empty if it does not."""
        rows, columns = pixels.shape[:2]
        width, height = self.size_px
        if (columns, rows) == (width, height):
            return ""
        if (columns, rows) == (height, width):
            cure = "they are turned by a quarter of a turn (EXIF orientation?): save them as those of the calibration"
        else:
            cure = "take them as they come, neither cut nor scaled"
        return f"images of {columns} x {rows} pixels, the camera's calibration is of {width} x {height}; {cure}"

    def project(self, points_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 2"]:
        """Return the pixels of points in the camera's frame."""
        if not (points_m[:, 2] > 0).all():
            number = int(np.flatnonzero(~(points_m[:, 2] > 0))[0]) + 1
            raise ConfigError(f"point {number} is at z = {points_m[number - 1, 2]:.4g} m, behind the camera")
        return self.seen(points_m)[0]

    def seen(
        self, points_m: Float64[np.ndarray, "points 3"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2 3"]]:
        """Return the pixels of points, also behind the camera, and their derivatives by the point, in px/m."""
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
        """Return the covariance of the pixel of a point in the camera's frame, to first order, in px²."""
        slope = self.seen(point_m[None])[1][0]
        return np.asarray(slope @ covariance_m2 @ slope.T)

    def distort(
        self, direct: Float64[np.ndarray, "points 2"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2 2"]]:
        """Return the distorted normalised coordinates (x/z, y/z) of undistorted ones, and their derivatives."""
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
        """Return the undistorted normalised coordinates (x/z, y/z) of pixels, by Newton's method."""
        inside = ((pixels >= -0.5) & (pixels <= np.array(self.size_px) - 0.5)).all(axis=1)
        if not inside.all():
            number = int(np.flatnonzero(~inside)[0])
            x, y = pixels[number]
            raise ConfigError(
                f"pixel {number + 1} is ({x:.1f}, {y:.1f}), outside the image of {self.size_px[0]} x {self.size_px[1]}"
            )
        wanted = (pixels - self.centre_px) / self.focal_px
        direct = wanted.copy()
        for _ in range(_UNDISTORT_STEPS):
            found, derivative = self.distort(direct)
            step = np.linalg.solve(derivative, (wanted - found)[..., None])[..., 0]
            direct += step
            if np.abs(step).max(initial=0.0) < 1e-12:
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
        base_m = float(np.linalg.norm(self.left_to_right.translation_m))
        require_range("cameras: base", base_m, low=1e-4, high=1.0, unit="m", cure="give the transform in metres")

    def project(
        self, points_m: Float64[np.ndarray, "points 3"]
    ) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2"]]:
        """Return the pixels in the left and the right image of points in the left camera's frame."""
        return self.left.project(points_m), self.right.project(self.left_to_right.apply(points_m))


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
    """Return the points with projections nearest to the pixels: maximum likelihood for equal errors of all pixels.

    ``left_px``, ``right_px``: pixels in the left and the right image, row by row. ``sigma_px``: standard deviation of
    each pixel coordinate, of spot and calibration together.
    """
    require_range("sigma_px", sigma_px, low=0, high=100, unit="px", open_low=True)
    try:
        points_m, derivative = _nearest_points(left_px, right_px, cameras)
    except _NoPointError as problem:
        others = _other_arrangements(left_px, right_px, cameras)
        raise ConfigError(f"{problem}{_cause(others)}") from problem
    inverse = np.linalg.inv(np.einsum("nij,nik->njk", derivative, derivative))
    return Triangulated(
        points_m=points_m,
        covariances_m2=sigma_px**2 * inverse,
        by_pixel_m=inverse @ np.swapaxes(derivative, 1, 2),
    )


class _NoPointError(ConfigError):
    """No point in front of the cameras has such pixels."""


def _nearest_points(
    left_px: Float64[np.ndarray, "points 2"], right_px: Float64[np.ndarray, "points 2"], cameras: StereoCameras
) -> tuple[Float64[np.ndarray, "points 3"], Float64[np.ndarray, "points 4 3"]]:
    """Return the points with projections nearest to the pixels, and the derivatives of these.

    `_NoPointError` without any.
    """
    points_m = _midpoints(cameras.left.undistort(left_px), cameras.right.undistort(right_px), cameras)
    wanted = np.concatenate([left_px, right_px], axis=1)
    for _ in range(_TRIANGULATION_STEPS):
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
        raise _NoPointError(
            f"point {worst + 1}: its two lines of sight miss each other by {reprojection_px[worst]:.1f} px, at most "
            f"{MAX_REPROJECTION_PX:g} px is allowed; the two images show different spots, or the calibration is wrong"
        )
    return points_m, derivative


def _turned(pixels: Float64[np.ndarray, "points 2"], camera: Camera) -> Float64[np.ndarray, "points 2"]:
    """Return the pixels in the image turned by 180 deg."""
    return np.asarray(np.subtract(camera.size_px, 1.0) - pixels)


def _other_arrangements(
    left_px: Float64[np.ndarray, "points 2"], right_px: Float64[np.ndarray, "points 2"], cameras: StereoCameras
) -> list[str]:
    """Return what may have been done to the images: each puts the points of all pixels before the cameras."""
    left = cameras.left
    right = cameras.right
    left_turned_px = _turned(left_px, left)
    right_turned_px = _turned(right_px, right)
    arrangements = {
        "the two images are exchanged": (right_px, left_px),
        "both images are turned by 180 deg": (left_turned_px, right_turned_px),
        "the left image is turned by 180 deg": (left_turned_px, right_px),
        "the right image is turned by 180 deg": (left_px, right_turned_px),
        "the two images are exchanged and turned by 180 deg": (right_turned_px, left_turned_px),
    }
    return [words for words, (first, second) in arrangements.items() if _fits(first, second, cameras)]


def _fits(
    left_px: Float64[np.ndarray, "points 2"], right_px: Float64[np.ndarray, "points 2"], cameras: StereoCameras
) -> bool:
    try:
        _nearest_points(left_px, right_px, cameras)
    except (ConfigError, np.linalg.LinAlgError):
        return False
    return True


def _cause(others: list[str]) -> str:
    """Return the arrangements as the end of a sentence; empty if there are none."""
    if not others:
        return ""
    # Images that are exchanged *and* turned fit as well as the right ones, in a frame that is turned.
    return (
        f"; it would fit if {', or if '.join(others)}: compare both images with those of the calibration before either "
        "is changed, because a wrong change may fit too, and gives another frame"
    )


def _midpoints(
    left: Float64[np.ndarray, "points 2"], right: Float64[np.ndarray, "points 2"], cameras: StereoCameras
) -> Float64[np.ndarray, "points 3"]:
    """Return the middle of the shortest line between two lines of sight, the start of the iteration."""
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
        raise _NoPointError(f"point {number}: its two lines of sight meet behind the cameras")
    return np.asarray((depths[:, :1] * first + depths[:, 1:] * second + back.translation_m) / 2)


def _projections(
    points_m: Float64[np.ndarray, "points 3"], cameras: StereoCameras
) -> tuple[Float64[np.ndarray, "points 4"], Float64[np.ndarray, "points 4 3"]]:
    """Return the left and right pixels of points, and their derivatives by the point, in pixels per metre."""
    left, by_left = cameras.left.seen(points_m)
    right, by_right = cameras.right.seen(cameras.left_to_right.apply(points_m))
    by_point = [by_left, by_right @ cameras.left_to_right.rotation]
    return np.concatenate([left, right], axis=1), np.concatenate(by_point, axis=1)
