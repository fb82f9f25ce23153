"""A place that a person points at in the left image, found in the right one by the texture around it.

The patches around the place are matched each by itself; a plane through their inverse depths gives that of the place,
and their scatter its error. So a patch that was matched wrongly shows, and a place at the edge of something is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64, StereoPair, UInt8, as_vector, is_finite
from markerseek.geometry import RangedPoints, StereoCameras, range_points
from markerseek.vision.patches import cut_patches
from markerseek.vision.texture import (
    BORDER_PX,
    DARK_COUNTS,
    FINE_HALF_PX,
    MAX_MISS_PX,
    MAX_SIGMA_PX,
    Levels,
    NotKnown,
    between_depths,
    match_patches,
    noise_counts,
    require_sizes,
    sigmas_px,
)

_STEP_PX = 6
_REACH = 2
"""Distance of neighbouring patches in the left image, and how many there are to each side of the middle."""

MIN_AROUND = 9
"""Fewest of the 25 patches around a place that must have texture, and be seen by both cameras."""

MAX_SCATTER_PX = 0.5
"""Largest scatter of their places in the right image about those of a plane."""

_OUTLYING = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchedPoint:
    """A place that both images show."""

    left_px: tuple[float, float]
    right_px: tuple[float, float]
    sigma_px: float
    """Standard deviation of its place in the right image, along the line on which it may lie."""
    camera_m: tuple[float, float, float]
    """In the left camera's frame."""


def match_point(pair: StereoPair, cameras: StereoCameras, left_px: tuple[float, float]) -> MatchedPoint | NotKnown:
    """Return the place that the left image shows at a pixel (x, y); `NotKnown` where the texture does not suffice.

    Raises `ConfigError` for a pixel outside of the image, and for images that have not the size of the calibration.
    """
    require_sizes(pair, cameras)
    width, height = cameras.left.size_px
    x, y = left_px
    if not (is_finite(x) and is_finite(y) and 0 <= x < width and 0 <= y < height):
        raise ConfigError(f"`pixel` is {x:g}, {y:g}; it must lie in the left image, of {width} x {height} pixels")
    where = f"at {x:.0f}, {y:.0f} of the left image"
    room_px = BORDER_PX + _STEP_PX * _REACH + 1
    if not (room_px <= x < width - room_px and room_px <= y < height - room_px):
        reason = f"the place {where} is nearer than {room_px} px to its border"
        return NotKnown(at_s=pair.at_s, cause="hidden", reason=reason)
    left = Levels.of(pair.left)
    places = _around(left_px)
    by_noise_px = sigmas_px(cut_patches(left.fine, places, half=FINE_HALF_PX), noise_counts(pair.left))
    textured = places[by_noise_px <= MAX_SIGMA_PX]
    if len(textured) < MIN_AROUND:
        return _without_texture(pair, places, textured, where)
    found, matched_px, matched_px2 = match_patches(textured, left, Levels.of(pair.right), cameras)
    points = range_points(found, matched_px, matched_px2, cameras)
    good = (np.linalg.norm(points.beside_px, axis=1) <= MAX_MISS_PX) & between_depths(points.nearness_per_m)
    if good.sum() < MIN_AROUND:
        reason = (
            f"what is {where} is not found in the right image: it is hidden there, or several places of it look alike "
            f"({int(good.sum())} of {len(textured)} patches are found, {MIN_AROUND} are needed)"
        )
        return NotKnown(at_s=pair.at_s, cause="hidden", reason=reason)
    return _placed(pair, cameras, left_px, found[good], points[good], where)


def _around(left_px: tuple[float, float]) -> Float64[np.ndarray, "places 2"]:
    """Return the places of the patches around a pixel."""
    steps = _STEP_PX * np.arange(-_REACH, _REACH + 1, dtype=np.float64)
    across, down = np.meshgrid(steps, steps)
    return np.asarray(np.rint(np.array(left_px)) + np.stack([across.ravel(), down.ravel()], axis=1))


def _without_texture(
    pair: StereoPair,
    places: Float64[np.ndarray, "places 2"],
    textured: Float64[np.ndarray, "textured 2"],
    where: str,
) -> NotKnown:
    """Say why there is too little texture around a place."""
    brightness = _median_counts(pair.left, places)
    what = f"{len(textured)} of {len(places)} patches around it have texture above the noise, {MIN_AROUND} are needed"
    if brightness < DARK_COUNTS:
        reason = f"it is dark {where}, with {brightness:.0f} counts: {what}"
        return NotKnown(at_s=pair.at_s, cause="dark", reason=reason)
    return NotKnown(at_s=pair.at_s, cause="no-texture", reason=f"there is too little texture {where}: {what}")


def _median_counts(image: UInt8[np.ndarray, "rows columns"], places: Float64[np.ndarray, "places 2"]) -> float:
    left, top = places.min(axis=0).astype(int) - FINE_HALF_PX
    right, bottom = places.max(axis=0).astype(int) + FINE_HALF_PX
    return float(np.median(image[top : bottom + 1, left : right + 1]))


def _placed(
    pair: StereoPair,
    cameras: StereoCameras,
    left_px: tuple[float, float],
    places: Float64[np.ndarray, "places 2"],
    points: RangedPoints,
    where: str,
) -> MatchedPoint | NotKnown:
    """Fit a plane of inverse depth through the patches around a place, without those that lie far off."""
    terms = np.concatenate([np.ones((len(places), 1)), places - np.array(left_px)], axis=1)
    used = np.ones(len(places), dtype=bool)
    for _ in range(3):
        plane = np.linalg.lstsq(terms[used], points.nearness_per_m[used], rcond=None)[0]
        beside = points.nearness_per_m - terms @ plane
        used = np.abs(beside) <= _OUTLYING * 1.4826 * float(np.median(np.abs(beside[used]))) + 1e-12
    nearness_per_m = float(plane[0])
    directions = np.append(cameras.left.undistort(np.array([left_px], dtype=np.float64))[0], 1.0)
    camera_m = directions / nearness_per_m
    right_m = cameras.left_to_right.apply(camera_m)
    right_px = cameras.right.project(right_m[None])[0]
    # Pixels in the right image per inverse depth.
    px_m = float(np.hypot(*(np.array(cameras.right.focal_px) * cameras.left_to_right.translation_m[:2])))
    scatter_px = px_m * float(np.sqrt(np.mean(beside[used] ** 2)))
    if used.sum() < MIN_AROUND or not scatter_px <= MAX_SCATTER_PX:
        reason = (
            f"the depth {where} is not known: {int(used.sum())} of {len(places)} patches lie on one surface, with a "
            f"scatter of {scatter_px:.1f} px: it is at the edge of something, or on a highlight"
        )
        return NotKnown(at_s=pair.at_s, cause="deforms", reason=reason)
    # Patches overlap, so that their errors do not average out.
    sigma_px = float(np.hypot(scatter_px, px_m * np.median(points.sigma_per_m[used])))
    x, y = right_px.tolist()
    return MatchedPoint(
        left_px=(float(left_px[0]), float(left_px[1])), right_px=(x, y), sigma_px=sigma_px, camera_m=as_vector(camera_m)
    )
