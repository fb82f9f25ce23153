"""The texture of a scene that two cameras see: patches at known depths, and where a later pair shows them.

`scene_texture` chooses the patches in a reference pair, `TextureFollower` finds them again. What moved is judged
in `scene_motion`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import msgspec
import numpy as np

from markerseek.core import Bool, ConfigError, Float64, Int64, StereoPair, UInt8
from markerseek.geometry import (
    CalibrationErrors,
    Camera,
    RangedPoints,
    RigidTransform,
    StereoCameras,
    range_points,
    seen_after,
)
from markerseek.vision.images import opencv
from markerseek.vision.keypoints import Keypoints, ranged_keypoints
from markerseek.vision.patches import Patches, best_of, cut_patches, find_patches

_PURPOSE = "following the texture of a scene"

Cause: TypeAlias = Literal[
    "dark",
    "no-texture",
    "blurred",
    "hidden",
    "several-motions",
    "deforms",
    "too-few",
]
"""Why a picture does not suffice."""


class NotKnown(msgspec.Struct, frozen=True, kw_only=True, tag="not-known"):
    """The picture does not show what moved; nothing is concluded from it."""

    at_s: float
    """Time of the pair."""
    cause: Cause
    reason: str
    """The same in a sentence, with the numbers."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPatches:
    """The patches of one camera."""

    places_px: Float64[np.ndarray, "patches 2"]
    fine: Patches
    """Cut from the image under a slight blur."""
    coarse: Patches
    """Cut from the image of a quarter of its size."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneTexture:
    """Patches of a reference pair."""

    at_s: float
    """Time of the pair."""
    cameras: StereoCameras
    calibration: CalibrationErrors
    """How well these are calibrated."""
    points: RangedPoints
    """Where they are, in the left camera's frame."""
    slopes_per_m: Float64[np.ndarray, "patches 2"]
    """Change of the inverse depth of the surface by one pixel to the right and one down in the left image."""
    left: CameraPatches
    right: CameraPatches
    parts: Int64[np.ndarray, " patches"]
    """Number of the part of the left image that each is in."""
    regions: Int64[np.ndarray, " patches"]
    """Number of the region of the left image that each is in: four parts."""
    keypoints: Keypoints
    """By which a scene is found again after a large move."""
    grain: float
    """Fine contrast of the left image over its brightness."""


_CELLS = (20, 16)
"""Columns and rows of cells, of which each gives the patch of its best texture."""

_PARTS = (8, 6)
"""Columns and rows of the parts of the image whose errors count as independent."""

_REGIONS = (4, 3)
"""Columns and rows of the regions that would move each in its own way if the scene deformed."""

MIN_PATCHES = 40
"""Fewest patches of a scene."""

FINE_HALF_PX = 9
COARSE_HALF_PX = 7
"""Half the width of a patch, in pixels of its image."""

SCALE = 4
"""Pixels of the image per pixel of the coarse one."""

DARK_COUNTS = 14.0
"""Brightness below which a part of the image counts as dark."""

MAX_SIGMA_PX = 0.12
"""Largest error of a patch by the noise of the image."""

_NEAREST_M = 0.025
_FARTHEST_M = 0.5
"""Range of the depths that are looked for."""

MAX_MISS_PX = 1.2
"""How far the lines of sight of both cameras may miss each other; calibrations miss by some tenths."""

BORDER_PX = SCALE * (COARSE_HALF_PX + 2)
"""Least distance of a patch from the border of its image."""

_BLUR_PX = 1.0
_WHITE_COUNTS = 245
_LEAST_STEREO_LIKENESS = 0.8
_PEAK_STEPS = 3
_RIVAL_MARGIN = 0.03
"""By what the likeness at the depth of a patch exceeds that at every other depth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """An image under a slight blur, and at a quarter of its size."""

    fine: UInt8[np.ndarray, "rows columns"]
    coarse: UInt8[np.ndarray, "coarse_rows coarse_columns"]

    @classmethod
    def of(cls, image: UInt8[np.ndarray, "rows columns"]) -> Levels:
        """Return both of an image."""
        cv2 = opencv(_PURPOSE)
        fine = cv2.GaussianBlur(image, (5, 5), _BLUR_PX)
        return cls(fine=fine, coarse=cv2.pyrDown(cv2.pyrDown(image)))


def scene_texture(
    pair: StereoPair, cameras: StereoCameras, *, calibration: CalibrationErrors | None = None
) -> SceneTexture | NotKnown:
    """Choose the patches of a reference pair, without the laser's light, and measure their depths.

    ``calibration``: how well the cameras are calibrated; None: as is usual.

    Raises `ConfigError` if the images have not the size of the calibration.
    """
    require_sizes(pair, cameras)
    left = Levels.of(pair.left)
    right = Levels.of(pair.right)
    noise = noise_counts(pair.left)
    places = _chosen(left, noise)
    if len(places) < MIN_PATCHES:
        return without_texture(pair, f"{len(places)} patches have texture above the noise, {MIN_PATCHES} are needed")
    places, matched, matched_px2 = match_patches(places, left, right, cameras)
    points = range_points(places, matched, matched_px2, cameras)
    good = (np.linalg.norm(points.beside_px, axis=1) <= MAX_MISS_PX) & between_depths(points.nearness_per_m)
    if good.sum() < MIN_PATCHES:
        return without_texture(
            pair, f"{int(good.sum())} patches are seen by both cameras at one depth, {MIN_PATCHES} are needed"
        )
    places = places[good]
    matched = matched[good]
    points = points[good]
    return SceneTexture(
        at_s=pair.at_s,
        cameras=cameras,
        calibration=calibration or CalibrationErrors(),
        points=points,
        slopes_per_m=_surface_slopes(points, cameras.left),
        left=CameraPatches(
            places_px=places, fine=cut_patches(left.fine, places, half=FINE_HALF_PX), coarse=_coarse(left, places)
        ),
        right=CameraPatches(
            places_px=matched, fine=cut_patches(right.fine, matched, half=FINE_HALF_PX), coarse=_coarse(right, matched)
        ),
        parts=_parts(places, pair.left.shape, _PARTS),
        regions=_parts(places, pair.left.shape, _REGIONS),
        keypoints=ranged_keypoints(pair.left, cameras.left, places, points),
        grain=grain(left.fine),
    )


def require_sizes(pair: StereoPair, cameras: StereoCameras) -> None:
    """Refuse images that have not the size of the calibration."""
    for name, image, camera in (("left", pair.left, cameras.left), ("right", pair.right, cameras.right)):
        if problem := camera.size_problem(image):
            raise ConfigError(f"{name} image: {problem}")


def without_texture(pair: StereoPair, what: str) -> NotKnown:
    """Say why there are too few patches."""
    brightness = float(np.median(pair.left))
    if brightness < DARK_COUNTS:
        return NotKnown(
            at_s=pair.at_s,
            cause="dark",
            reason=f"the picture is dark: half of it is below {brightness:.0f} counts; {what}",
        )
    return NotKnown(at_s=pair.at_s, cause="no-texture", reason=f"the picture has too little texture: {what}")


def noise_counts(image: UInt8[np.ndarray, "rows columns"]) -> float:
    """Return the standard deviation of a pixel's noise, at least half a count.

    The difference of two Laplacians (J. Immerkær, Comput. Vis. Image Underst. 64, 1996) has six times that of a pixel
    and none of a smooth image; its median is little changed by texture.
    """
    cv2 = opencv(_PURPOSE)
    kernel = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]], dtype=np.float32)
    # Every other pixel of every other row of the filtered image is plenty.
    filtered = cv2.filter2D(image, cv2.CV_32F, kernel)[::4, ::4]
    lit = image[::4, ::4] > DARK_COUNTS
    if not lit.any():
        return 1.0
    return max(0.5, float(np.median(np.abs(filtered[lit]))) / 0.6745 / 6)


def grain(image: UInt8[np.ndarray, "rows columns"]) -> float:
    """Return the fine contrast of an image over its brightness."""
    cv2 = opencv(_PURPOSE)
    return float(np.abs(cv2.Laplacian(image, cv2.CV_16S)).mean() / max(1.0, float(image.mean())))


def _chosen(left: Levels, noise: float) -> Float64[np.ndarray, "patches 2"]:
    """Return the place of the best texture in each cell of the image that has enough of it."""
    cv2 = opencv(_PURPOSE)
    half = cv2.resize(left.fine, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    strength = cv2.cornerMinEigenVal(half, 9)
    usable = cv2.erode(
        ((half < _WHITE_COUNTS) & (half > DARK_COUNTS)).astype(np.uint8), np.ones((15, 15), np.uint8), borderValue=0
    )
    strength[usable == 0] = 0
    border = BORDER_PX // 2 + 1
    inner = strength[border:-border, border:-border]
    columns = np.linspace(0, inner.shape[1], _CELLS[0] + 1).astype(int)
    rows = np.linspace(0, inner.shape[0], _CELLS[1] + 1).astype(int)
    places = []
    for top, bottom in pairwise(rows):
        for first, last in pairwise(columns):
            cell = inner[top:bottom, first:last]
            row, column = np.unravel_index(int(np.argmax(cell)), cell.shape)
            if cell[row, column] > 0:
                # At a whole pixel, so that cutting it does not blur it.
                places.append((2 * (first + column + border), 2 * (top + row + border)))
    if not places:
        return np.empty((0, 2))
    found = np.array(places, dtype=np.float64)
    return np.asarray(found[sigmas_px(cut_patches(left.fine, found, half=FINE_HALF_PX), noise) <= MAX_SIGMA_PX])


def sigmas_px(patches: Patches, noise: float) -> Float64[np.ndarray, " patches"]:
    """Return the errors of fine patches by the noise of a pixel, in the direction of their least texture."""
    side = 2 * FINE_HALF_PX + 1
    # Noise under the blur has a third of its deviation, over some six pixels that are alike: about that of a pixel.
    return np.asarray(noise / (patches.contrast_counts * side) * np.sqrt(np.linalg.eigvalsh(patches.inverse)[:, -1]))


def match_patches(
    places: Float64[np.ndarray, "patches 2"], left: Levels, right: Levels, cameras: StereoCameras
) -> tuple[Float64[np.ndarray, "found 2"], Float64[np.ndarray, "found 2"], Float64[np.ndarray, "found 2 2"]]:
    """Return the places that the right image shows too, the places there, and the covariances of these."""
    coarse = _coarse(left, places)
    tried = _along_the_line(places, cameras)
    best, likeness = best_of(coarse, right.coarse, tried / SCALE)
    at = np.argmax(likeness, axis=1)
    beside = np.abs(np.arange(likeness.shape[1]) - at[:, None]) > _PEAK_STEPS
    rival = np.where(beside, likeness, -1.0).max(axis=1)
    unique = (best >= _LEAST_STEREO_LIKENESS - 0.1) & (rival < best - _RIVAL_MARGIN)
    places = places[unique]
    start = tried[np.arange(len(at)), at][unique]
    upright = np.tile(np.eye(2), (len(places), 1, 1))
    rough = find_patches(coarse[unique], right.coarse, start / SCALE, upright, reach_px=3.0)
    patches = cut_patches(left.fine, places, half=FINE_HALF_PX)
    found = find_patches(patches, right.fine, rough.places_px * SCALE, upright, reach_px=6.0)
    rows, columns = right.fine.shape
    x, y = found.places_px.T
    inside = (x >= BORDER_PX) & (x < columns - BORDER_PX) & (y >= BORDER_PX) & (y < rows - BORDER_PX)
    good = (found.likeness >= _LEAST_STEREO_LIKENESS) & inside
    return places[good], found.places_px[good], found.covariances_px2[good]


def _along_the_line(
    places: Float64[np.ndarray, "patches 2"], cameras: StereoCameras
) -> Float64[np.ndarray, "patches tried 2"]:
    """Return where the right camera would see each place at depths a coarse pixel apart."""
    directions = np.concatenate([cameras.left.undistort(places), np.ones((len(places), 1))], axis=1)
    turned = directions @ cameras.left_to_right.rotation.T
    base_m = cameras.left_to_right.translation_m
    span_px = float(np.hypot(*(np.array(cameras.right.focal_px) * base_m[:2])) * (1 / _NEAREST_M - 1 / _FARTHEST_M))
    nearness = np.linspace(1 / _FARTHEST_M, 1 / _NEAREST_M, max(8, int(span_px / SCALE)))
    scaled = turned[:, None, :] + nearness[None, :, None] * base_m
    pixels = cameras.right.seen(scaled.reshape(-1, 3))[0]
    return np.asarray(pixels.reshape(len(places), len(nearness), 2))


def _coarse(levels: Levels, places: Float64[np.ndarray, "patches 2"]) -> Patches:
    return cut_patches(levels.coarse, places / SCALE, half=COARSE_HALF_PX)


def between_depths(nearness_per_m: Float64[np.ndarray, " points"]) -> Bool[np.ndarray, " points"]:
    """Return whether inverse depths lie within the depths that are looked for."""
    return np.asarray((nearness_per_m > 1 / _FARTHEST_M) & (nearness_per_m < 1 / _NEAREST_M))


def _parts(
    places: Float64[np.ndarray, "patches 2"], shape: tuple[int, ...], number: tuple[int, int]
) -> Int64[np.ndarray, " patches"]:
    """Return which part of an image each place is in, by its number; ``number``: of parts across and down."""
    column = np.floor(places[:, 0] / shape[1] * number[0]).astype(np.int64)
    row = np.floor(places[:, 1] / shape[0] * number[1]).astype(np.int64)
    return np.asarray(row * number[0] + column)


def _surface_slopes(points: RangedPoints, camera: Camera) -> Float64[np.ndarray, "patches 2"]:
    """Return the slopes, by the left pixel, of a surface of second order through the inverse depths of most points."""
    x = points.directions[:, 0]
    y = points.directions[:, 1]
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    used = np.ones(len(x), dtype=bool)
    for _ in range(4):
        surface = np.linalg.lstsq(terms[used], points.nearness_per_m[used], rcond=None)[0]
        beside = np.abs(points.nearness_per_m - terms @ surface)
        used = beside <= 4 * float(np.median(beside)) + 1e-12
    by_x = surface[1] + 2 * surface[3] * x + surface[4] * y
    by_y = surface[2] + surface[4] * x + 2 * surface[5] * y
    by_direction = np.stack([by_x, by_y], axis=1)
    return np.asarray(np.einsum("ni,nij->nj", by_direction, _by_pixel(points, camera)))


def _by_pixel(points: RangedPoints, camera: Camera) -> Float64[np.ndarray, "points 2 2"]:
    """Return the derivatives of directions (x/z, y/z) by the pixel."""
    bend = camera.distort(points.directions[:, :2])[1]
    return np.asarray(np.linalg.inv(bend) / np.array(camera.focal_px))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedView:
    """Where and in which form both cameras see the patches after a motion."""

    left_px: Float64[np.ndarray, "patches 2"]
    right_px: Float64[np.ndarray, "patches 2"]
    left_forms: Float64[np.ndarray, "patches 2 2"]
    right_forms: Float64[np.ndarray, "patches 2 2"]


def predict(texture: SceneTexture, motion: RigidTransform) -> ExpectedView:
    """Return where and in which form both cameras see the patches after a motion of the scene."""
    left_px, right_px = seen_after(texture.points, motion, texture.cameras)
    left_forms, right = _forms(texture, motion)
    still = RigidTransform(source=motion.source, target=motion.target, rotation=np.eye(3), translation_m=np.zeros(3))
    # A patch of the right image is cut where that camera saw the point at first.
    right_forms = right @ np.linalg.inv(_forms(texture, still)[1])
    return ExpectedView(left_px=left_px, right_px=right_px, left_forms=left_forms, right_forms=right_forms)


def _forms(
    texture: SceneTexture, motion: RigidTransform
) -> tuple[Float64[np.ndarray, "patches 2 2"], Float64[np.ndarray, "patches 2 2"]]:
    """Return the derivatives of left and right pixels after a motion, by the left pixel before it."""
    points = texture.points
    cameras = texture.cameras
    by_pixel = np.zeros((len(points.directions), 3, 2))
    by_pixel[:, :2] = _by_pixel(points, cameras.left)
    scaled = points.directions @ motion.rotation.T + points.nearness_per_m[:, None] * motion.translation_m
    change = motion.rotation @ by_pixel + motion.translation_m[:, None] * texture.slopes_per_m[:, None, :]
    right_of = cameras.left_to_right
    right_scaled = scaled @ right_of.rotation.T + points.nearness_per_m[:, None] * right_of.translation_m
    right_change = right_of.rotation @ change + right_of.translation_m[:, None] * texture.slopes_per_m[:, None, :]
    left = cameras.left.seen(scaled)[1] @ change
    right = cameras.right.seen(right_scaled)[1] @ right_change
    return left, right
