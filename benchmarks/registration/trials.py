"""Simulated registrations: markers with the errors of searches, a stereo camera with its own, and the TRE."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from benchmarks.registration.marker_errors import MarkerError
from markerseek.core import ConfigError, Float64, MarkerPosition, is_whole, require_range
from markerseek.geometry import Registration, RigidTransform, register_points, triangulate
from markerseek.registration.report import TARGET_DEPTH_M
from markerseek.registration.shared_errors import FOCAL_LENGTH, camera_shared_m, trus_shared_m
from markerseek.sim import camera_above, endoscope

DISTANCE_FROM_AXIS_M = 60e-3
FACE_RADIUS_M = 10e-3
"""Distances of the grid of markers, and of the array's face, from the axis of the probe."""

MAX_TILT_DEG = 15.0
"""The camera's line of sight is off the normal of the grid by at most this angle, in degrees."""

MIN_SIGMA_PX = 0.01
"""Least standard deviation that is assumed of a pixel."""

Source = Literal["angle", "lateral and depth", "spot", "calibration"]
"""A source of error."""

SOURCES: tuple[Source, ...] = get_args(Source)

GRID_STEP_M = 20e-3
"""Step of the paper's 3 x 3 grid of markers."""

MARKER_PLACES: dict[int, tuple[tuple[int, int], ...]] = {
    3: ((-1, -1), (0, 1), (1, -1)),
    4: ((-1, -1), (-1, 1), (1, 1), (1, -1)),
    6: ((-1, -1), (-1, 1), (0, 1), (0, -1), (1, -1), (1, 1)),
    9: ((-1, -1), (-1, 0), (-1, 1), (0, 1), (0, 0), (0, -1), (1, -1), (1, 0), (1, 1)),
}
"""Places of the markers in steps along x and y of the TRUS frame, in an order with little rotation (x is across)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of a registration."""

    camera_m: float = 0.1
    """Distance of the camera from the middle of the markers."""
    markers: int = 9
    """Number of markers: 3, 4, 6 or 9 places of the grid."""
    relief_m: float = 5e-3
    """Range of the heights of the tissue, peak to peak."""
    frames: int = 25
    """Camera frames for each spot."""
    spot_sigma_px: float = 0.3
    calibration_sigma_px: float = 0.2
    """``spot_sigma_px`` and ``calibration_sigma_px``: standard deviations of the spot in one frame, and of the
    calibration at a point of the image."""
    common_calibration: bool = False
    """Whether the error of the calibration is the same at all points of an image, a shift; else it differs."""
    base_m: float = 5e-3
    """Distance between the two cameras."""
    focal_px: float = 1100.0
    """Focal length."""
    focal_error: float = 0.0
    """Relative error of the focal length that the calibration gives."""
    angle_factor: float = 1.0
    """Factor of the errors of the angle."""
    sound_speed_error: float = 0.0
    """Relative error of the sound speed with which the markers are imaged."""
    sources: tuple[Source, ...] = SOURCES
    """The sources of error that act; the assumed sigmas stay those of all."""
    shared_errors: float = 0.0
    """Factor of the errors that all points share: each is drawn once a registration, from the prior that the
    registration assumes of it."""
    shared_assumed: bool = True
    """Whether the registration takes these errors for unknowns; else for 0."""
    refined: bool = True

    def __post_init__(self) -> None:
        if self.markers not in MARKER_PLACES:
            raise ConfigError(f"markers is {self.markers}, it must be one of {', '.join(map(str, MARKER_PLACES))}")
        if not (is_whole(self.frames) and self.frames >= 1):
            raise ConfigError(f"frames is {self.frames}, at least 1 is needed")
        for name, low, high, unit in (
            ("camera_m", 0.02, 1.0, "m"),
            ("relief_m", 0.0, 0.02, "m"),
            ("base_m", 1e-3, 0.1, "m"),
            ("focal_px", 100.0, 1e4, "px"),
            ("focal_error", -0.1, 0.1, ""),
            ("angle_factor", 0.0, 100.0, ""),
            ("sound_speed_error", -0.1, 0.1, ""),
            ("shared_errors", 0.0, 100.0, ""),
        ):
            require_range(name, getattr(self, name), low=low, high=high, unit=unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One registration: errors at the fiducials and at the target, and what was expected there, in metres.

    ``probability`` is that of residuals as large or larger, if the sigmas are right.
    """

    fre_m: float
    tre_m: float
    expected_tre_m: float
    expected_tre95_m: float
    probability: float


def registrations(
    conditions: Conditions, errors: Sequence[MarkerError], *, count: int, rng: np.random.Generator
) -> list[Trial]:
    """Register as often as asked, each time with another scene."""
    return [_trial(conditions, errors, rng) for _ in range(count)]


def _trial(conditions: Conditions, errors: Sequence[MarkerError], rng: np.random.Generator) -> Trial:
    places = GRID_STEP_M * np.array(MARKER_PLACES[conditions.markers], dtype=float)
    heights = DISTANCE_FROM_AXIS_M + conditions.relief_m * rng.uniform(-0.5, 0.5, len(places))
    points_m = np.column_stack([places, heights])
    true = camera_above(
        np.array([0.0, 0.0, DISTANCE_FROM_AXIS_M]),
        distance_m=conditions.camera_m,
        roll_deg=rng.uniform(0, 360),
        tilt_deg=rng.uniform(-MAX_TILT_DEG, MAX_TILT_DEG),
    )
    found = _register(points_m, true, conditions, errors, rng)
    target_m = points_m.mean(axis=0) - [0, 0, TARGET_DEPTH_M]
    off_m = found.transform.apply(true.inverse().apply(target_m)) - target_m
    # Horn's form does not minimise chi squared, by whose root the expected error is scaled.
    expected = found if conditions.refined else found.errors
    return Trial(
        fre_m=found.fre_m,
        tre_m=float(np.linalg.norm(off_m)),
        expected_tre_m=expected.tre_m(target_m),
        expected_tre95_m=expected.tre95_m(target_m),
        probability=found.probability,
    )


def _register(
    points_m: Float64[np.ndarray, "points 3"],
    true: RigidTransform,
    conditions: Conditions,
    errors: Sequence[MarkerError],
    rng: np.random.Generator,
) -> Registration:
    """Registration of points whose markers and spots have the errors that act."""
    markers = [_marker(point, errors[int(rng.integers(len(errors)))], conditions) for point in points_m.tolist()]
    cameras = endoscope(focal_px=conditions.focal_px, base_m=conditions.base_m)
    mean_sigma_px = conditions.spot_sigma_px / math.sqrt(conditions.frames)
    common = conditions.shared_errors * rng.standard_normal(8)
    left, right = (
        exact + _pixel_errors(len(points_m), mean_sigma_px, conditions, rng) + conditions.calibration_sigma_px * shift
        for exact, shift in zip(cameras.project(true.inverse().apply(points_m)), (common[:2], common[2:4]), strict=True)
    )
    sigma_px = max(math.hypot(mean_sigma_px, conditions.calibration_sigma_px), MIN_SIGMA_PX)
    focal_px = conditions.focal_px * (1 + conditions.focal_error + FOCAL_LENGTH * common[4])
    assumed = endoscope(focal_px=focal_px, base_m=conditions.base_m)
    seen = triangulate(left, right, assumed, sigma_px=sigma_px)
    trus_m = np.array([found for found, _ in markers])
    camera_shared = camera_shared_m(seen, left, right, assumed, calibration_sigma_px=conditions.calibration_sigma_px)
    return register_points(
        seen.points_m,
        trus_m + trus_shared_m(points_m) @ common[5:],
        source_covariances_m2=seen.covariances_m2,
        target_covariances_m2=np.array([covariance for _, covariance in markers]),
        source_shared_m=camera_shared if conditions.shared_assumed else None,
        target_shared_m=trus_shared_m(trus_m) if conditions.shared_assumed else None,
        refined=conditions.refined,
    )


def _marker(
    point_m: list[float], error: MarkerError, conditions: Conditions
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]:
    """Where a search finds the marker at a point, and the covariance that it says."""
    factor = conditions.angle_factor
    sigma_m = (factor * error.angle_sigma_m, error.lateral_sigma_m, error.depth_sigma_m)
    said = MarkerPosition(position_m=(point_m[0], point_m[1], point_m[2]), sigma_m=sigma_m)
    angle_m = factor * error.angle_m if "angle" in conditions.sources else 0.0
    along_m, deep_m = (error.lateral_m, error.depth_m) if "lateral and depth" in conditions.sources else (0.0, 0.0)
    deep_m += conditions.sound_speed_error * (math.hypot(point_m[0], point_m[2]) - FACE_RADIUS_M)
    return point_m + np.array([angle_m, along_m, deep_m]) @ said.axes, said.covariance_m2


def _pixel_errors(
    count: int, mean_sigma_px: float, conditions: Conditions, rng: np.random.Generator
) -> Float64[np.ndarray, "points 2"]:
    """Errors of the pixels of one camera."""
    spot = mean_sigma_px * rng.standard_normal((count, 2))
    calibration = conditions.calibration_sigma_px * rng.standard_normal((count, 2))
    if conditions.common_calibration:
        calibration[:] = calibration[0]
    return spot * ("spot" in conditions.sources) + calibration * ("calibration" in conditions.sources)
