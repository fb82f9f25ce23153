"""The laser spot in the images of one camera: its pixel with a standard deviation, or why there is not exactly one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.optimize import least_squares

from markerseek.core import ConfigError, Float32, Float64, Int64, StereoPair, UInt8, counted
from markerseek.vision.images import brightness, opencv

MAX_SIZE_PX = 61
"""Widest spot in pixels: what is wider, such as tissue lit by the endoscope, counts as background."""

MIN_COUNTS = 12.0
"""Least height of a spot over its surroundings, in counts of 255."""

_NOISE_SIGMAS = 8.0
"""Least height over the scatter of the image, in standard deviations; highlights on wet tissue have long tails."""

SECOND_SHARE = 0.5
"""Height of another bright place over that of the brightest, from which the two cannot be distinguished."""

_MIN_SHARE = 0.6
"""Least share of the frames that must show the spot."""

MAX_MOTION_PX = 2.0
"""Largest scatter of the spot from frame to frame, in pixels: more is motion, and no mean would be right."""

_BLUR_PX = 1.5
"""Standard deviation of the smoothing before the brightest place is searched, in pixels."""

_FULL_COUNTS = 250
"""A pixel that reaches this in any frame is left out: its count no longer follows the light."""

_REACH_RADII = 3.0
"""Radii of a Gaussian spot beyond which pixels show tissue only, whose texture would pull at the spot."""

_TILE_SHARE = 2 / 3
"""Side of the tiles of the jackknife over that reach: texture and grains of speckle are smaller. A bright place nearer
to the middle than that is such a grain, not another spot."""

_EXPONENTS = (0.6, 6.0)
"""Exponents of the profile: 1 is a Gaussian, more an even disc such as the end of a fibre, less has wide skirts."""

_MAX_RADIUS_PX = MAX_SIZE_PX / 4
"""Largest radius of a spot, in pixels."""

_PURPOSE = "finding the laser spot in camera images"


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserSpot:
    """The laser spot."""

    x_px: float
    y_px: float
    """``x_px`` and ``y_px``: middle of a super-Gaussian profile on an even background, fitted to the mean of the
    frames, in pixels from the centre of the first pixel."""
    sigma_px: float | None
    """Standard deviation of that (root mean square of both directions): from the scatter of the frames, and from how
    much parts of the spot disagree, because texture and frozen speckle are the same in all frames. None with fewer than
    three frames."""
    frames: int
    """Number of frames that show it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoSpot:
    """There is no spot that can be measured, and why."""

    reason: str
    places_px: tuple[tuple[float, float], ...] = ()
    """Pixels (x, y) of what was taken for a spot; empty if nothing was."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoSpots:
    """Two places are about as bright: their pixels (x, y), the brighter one first."""

    places_px: tuple[tuple[float, float], tuple[float, float]]

    @property
    def reason(self) -> str:
        """What is wrong, in words."""
        (x1, y1), (x2, y2) = self.places_px
        return (
            f"two places are about as bright, at ({x1:.0f}, {y1:.0f}) and ({x2:.0f}, {y2:.0f}) px; cover reflections, "
            "or record frames with the laser off as well"
        )


SpotAnswer: TypeAlias = LaserSpot | NoSpot | TwoSpots
"""What a camera's images say."""


def find_spot(
    frames: Sequence[UInt8[np.ndarray, " ..."]], *, dark: Sequence[UInt8[np.ndarray, " ..."]] = ()
) -> SpotAnswer:
    """Find the laser spot in frames of one camera that does not move; 25 are usual.

    ``frames``: images with the laser on, shape (rows, columns) or (rows, columns, 3), 8 bits. ``dark``: images of the
    same scene with the laser off; their mean is subtracted, and highlights with it. Where highlights move, images with
    the laser on and off should alternate: the spot is where it is brighter than in any of ``dark``.
    """
    _require_alike([*frames, *dark])
    gray = [brightness(frame) for frame in frames]
    off = [brightness(frame) for frame in dark]
    lit = _mean(gray)
    background = _mean(off) if off else np.zeros_like(lit)
    mean = lit - background
    height = _height(_blinks(gray, off) if off else lit)
    middle = float(np.median(height))
    # The median deviation of Gaussian noise is 0.6745 of its standard deviation.
    scatter = float(np.median(np.abs(height - middle))) / 0.6745
    level = max(middle + _NOISE_SIGMAS * scatter, MIN_COUNTS)
    row, column = np.unravel_index(int(np.argmax(height)), height.shape)
    peak = float(height[row, column])
    if not peak > level:
        return NoSpot(
            reason=f"no spot: the brightest place is {peak:.1f} counts over its surroundings, {level:.1f} are needed; "
            "check that the laser is on and in view, and that the camera does not block infrared light"
        )
    first = (int(column), int(row))
    spot = _fitted(mean, gray, first)
    if spot is None:
        return NoSpot(reason=_no_form(gray, first), places_px=((float(first[0]), float(first[1])),))
    second = _second(height, spot, first, level=max(level, SECOND_SHARE * peak))
    if second is not None:
        return TwoSpots(places_px=((float(first[0]), float(first[1])), second))
    return _judged(spot, [frame[spot.pixels] - background[spot.pixels] for frame in gray])


def _no_form(frames: Sequence[UInt8[np.ndarray, "rows columns"]], place: tuple[int, int]) -> str:
    """Say that a bright place (x, y) has not the form of a spot, and whether it is saturated."""
    column, row = place
    half = MAX_SIZE_PX // 2
    near = (slice(max(0, row - half), row + half + 1), slice(max(0, column - half), column + half + 1))
    full = int((np.max([frame[near] for frame in frames], axis=0) >= _FULL_COUNTS).sum())
    where = f"the brightest place, at ({column}, {row}) px, has not the form of a spot"
    if full:
        return (
            f"{where}: {counted(full, 'pixel')} around it are saturated ({_FULL_COUNTS} counts or more); shorten the "
            "exposure or take less light, so that a rim around the middle is not white, and hide reflections"
        )
    return f"{where}; hide reflections, or use a smaller spot"


def _require_alike(images: list[UInt8[np.ndarray, " ..."]]) -> None:
    if not images:
        raise ConfigError("no camera frame was given; at least 1 is needed, 25 are usual")
    for number, image in enumerate(images, start=1):
        if image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise ConfigError(
                f"camera frame {number} is {image.dtype} of shape {image.shape}, it must be 8 bits, (rows, columns) or "
                "(rows, columns, 3)"
            )
        if image.shape != images[0].shape:
            raise ConfigError(
                f"camera frame {number} has the shape {image.shape}, the first has {images[0].shape}; give frames of "
                "one camera"
            )
        if min(image.shape[:2]) < 2 * MAX_SIZE_PX:
            raise ConfigError(
                f"camera frame {number} has the shape {image.shape}, at least {2 * MAX_SIZE_PX} pixels are needed in "
                "both directions"
            )


def _mean(images: Sequence[UInt8[np.ndarray, "rows columns"]]) -> Float32[np.ndarray, "rows columns"]:
    # NumPy's mean of 25 large images would first make them one array.
    total = np.zeros(images[0].shape, dtype=np.float32)
    for image in images:
        total += image
    total /= len(images)
    return total


def _blinks(
    lit: Sequence[UInt8[np.ndarray, "rows columns"]], off: Sequence[UInt8[np.ndarray, "rows columns"]]
) -> Float32[np.ndarray, "rows columns"]:
    """Return how much brighter each pixel is in most images with the laser on than in all with it off.

    A highlight that moves is at one place in few images, and was there or beside it when the laser was off.
    """
    fewer = int((1 - _MIN_SHARE) * len(lit))
    most = np.partition(np.stack(lit), fewer, axis=0)[fewer]
    over = most.astype(np.float32) - np.max(off, axis=0)
    middle = float(np.median(over))
    scatter = float(np.median(np.abs(over - middle))) / 0.6745
    # Tissue between two ways of highlights would stand out from these, which are far below it.
    return np.asarray(np.maximum(over, middle - 3 * scatter))


def _height(image: Float32[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "rows columns"]:
    """Return the height over the surroundings: a white top-hat, which removes all that is wider than its kernel."""
    cv2 = opencv(_PURPOSE)
    smooth = cv2.GaussianBlur(image, (0, 0), _BLUR_PX)
    kernel = cv2.getStructuringElement(cv2.MORPH_RECT, (MAX_SIZE_PX, MAX_SIZE_PX))
    height: Float32[np.ndarray, "rows columns"] = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, kernel)
    return height


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """A super-Gaussian profile on an even background, and how it follows the pixels that were used.

    ``gain`` is the change of height, x and y of the middle by a count of each pixel.
    """

    height: float
    x_px: float
    y_px: float
    reach_px: float
    systematic_px: float
    pixels: tuple[Int64[np.ndarray, " pixels"], Int64[np.ndarray, " pixels"]]
    gain: Float64[np.ndarray, "3 pixels"]


def _second(
    height: Float32[np.ndarray, "rows columns"], spot: _Fit, first: tuple[int, int], *, level: float
) -> tuple[float, float] | None:
    """Return the brightest place above a level that is no part of the spot; None if there is none."""
    cv2 = opencv(_PURPOSE)
    _, labels = cv2.connectedComponents((height > level).astype(np.uint8), connectivity=8)
    rows, columns = np.nonzero((labels > 0) & (labels != labels[first[1], first[0]]))
    apart = np.hypot(columns - spot.x_px, rows - spot.y_px) > _TILE_SHARE * spot.reach_px
    if not apart.any():
        return None
    rows = rows[apart]
    columns = columns[apart]
    brightest = int(np.argmax(height[rows, columns]))
    return float(columns[brightest]), float(rows[brightest])


def _judged(spot: _Fit, frames: list[Float32[np.ndarray, " pixels"]]) -> SpotAnswer:
    """Return the spot with the scatter of its place from frame to frame, where enough frames show it.

    ``frames``: the pixels of the fit in each frame.
    """
    seen = np.stack(frames).astype(np.float64)
    change = (seen - seen.mean(axis=0)) @ spot.gain.T
    heights = spot.height + change[:, 0]
    shown = heights >= _MIN_SHARE * spot.height
    count = int(shown.sum())
    if count < _MIN_SHARE * len(frames):
        return NoSpot(
            reason=f"the spot is seen in {count} of {len(frames)} frames, {_MIN_SHARE:.0%} are needed; keep the "
            "laser on while the camera records",
            places_px=((spot.x_px, spot.y_px),),
        )
    if count < 3:
        return LaserSpot(x_px=spot.x_px, y_px=spot.y_px, sigma_px=None, frames=count)
    # A brighter frame shows the same shift as a larger change.
    shifts_px = change[shown, 1:] * (spot.height / heights[shown])[:, None]
    scatter_px = float(np.sqrt(np.mean(np.var(shifts_px, axis=0, ddof=1))))
    if not scatter_px <= MAX_MOTION_PX:
        return NoSpot(
            reason=f"the spot moves by {scatter_px:.1f} px from frame to frame, {MAX_MOTION_PX:g} px is the limit; "
            "hold camera and laser still",
            places_px=((spot.x_px, spot.y_px),),
        )
    sigma_px = math.hypot(scatter_px / math.sqrt(count), spot.systematic_px)
    return LaserSpot(x_px=spot.x_px, y_px=spot.y_px, sigma_px=sigma_px, frames=count)


def _fitted(
    image: Float32[np.ndarray, "rows columns"],
    frames: Sequence[UInt8[np.ndarray, "rows columns"]],
    first: tuple[int, int],
) -> _Fit | None:
    """Fit a super-Gaussian profile of any ellipse, on a plane, by least squares; None if it has no such form.

    ``image``: the mean of the frames over their background.

    A centroid was pulled by 0.1 px where a saturated top is cut off beside the middle, and by 0.3 px by texture.
    """
    half = MAX_SIZE_PX // 2
    column, row = first
    top = max(0, row - half)
    left = max(0, column - half)
    near = (slice(top, row + half + 1), slice(left, column + half + 1))
    rows, columns = np.nonzero(np.max([frame[near] for frame in frames], axis=0) < _FULL_COUNTS)
    rows = rows + top
    columns = columns + left
    # Height, x and y of the middle, ln of the radius, two of the ellipse, ln of the exponent, three of the plane.
    level = float(np.median(image[rows, columns]))
    if not image[row, column] > level:
        return None
    values = np.array([float(image[row, column]) - level, column, row, math.log(4.0), 0, 0, 0, level, 0, 0])
    centre = values[1:3].copy()
    low = [0, column - half, row - half, 0, -0.9, -0.9, math.log(_EXPONENTS[0]), *[-np.inf] * 3]
    most = math.log(_MAX_RADIUS_PX)
    high = [np.inf, column + half, row + half, most, 0.9, 0.9, math.log(_EXPONENTS[1]), *[np.inf] * 3]
    reach_px = float(half)
    for _ in range(3):
        within = np.hypot(columns - values[1], rows - values[2]) <= reach_px
        x = columns[within].astype(np.float64)
        y = rows[within].astype(np.float64)
        wanted = image[rows[within], columns[within]].astype(np.float64)
        if len(wanted) < 4 * len(values):
            return None
        place = (x, y, centre)
        values = least_squares(
            lambda tried, *at, seen: _profile(tried, *at)[0] - seen,
            values,
            jac=lambda tried, *at, seen: _profile(tried, *at)[1],  # noqa: ARG005  SciPy gives both the same
            args=place,
            kwargs={"seen": wanted},
            bounds=(low, high),
            x_scale="jac",
        ).x
        radius_px = math.exp(values[3])
        # As weak as a Gaussian at its reach; an even disc needs tissue beside it.
        reach_px = radius_px * max(_REACH_RADII ** math.exp(-values[6]), 2.0)
    fitted, slopes = _profile(values, *place)
    # Of one size: a saturated top leaves the height nearly open, and its derivative small.
    scale = np.linalg.norm(slopes, axis=0)
    if not (values[0] > MIN_COUNTS / 2 and radius_px < 0.99 * _MAX_RADIUS_PX and scale.all()):
        return None
    even = slopes / scale
    tiles = np.floor(np.stack([x - values[1], y - values[2]], axis=1) / (_TILE_SHARE * reach_px))
    variances = _jackknife(tiles, wanted - fitted, even) / scale**2
    return _Fit(
        height=float(values[0]),
        x_px=float(values[1]),
        y_px=float(values[2]),
        reach_px=reach_px,
        systematic_px=math.sqrt(variances[1:3].mean()),
        pixels=(rows[within], columns[within]),
        gain=np.linalg.lstsq(even.T @ even, even.T, rcond=None)[0][:3] / scale[:3, None],
    )


def _profile(
    values: Float64[np.ndarray, " values"],
    x: Float64[np.ndarray, " pixels"],
    y: Float64[np.ndarray, " pixels"],
    centre: Float64[np.ndarray, " 2"],
) -> tuple[Float64[np.ndarray, " pixels"], Float64[np.ndarray, "pixels values"]]:
    """Return the super-Gaussian profile on a plane, and its derivatives."""
    height, x0, y0, log_radius, stretch, shear, log_exponent, level, across, down = values
    dx = x - x0
    dy = y - y0
    narrow = math.exp(-2 * log_radius)
    square = narrow * ((1 + stretch) * dx * dx + (1 - stretch) * dy * dy + 2 * shear * dx * dy)
    # 0 at the middle, where its logarithm is not finite.
    square = np.maximum(square, 1e-12)
    exponent = math.exp(log_exponent)
    power = square**exponent
    shape = np.exp(-power / 2)
    light = height * shape
    # Minus twice the derivative by the square.
    fall = light * exponent * power / square
    terms = (
        shape,
        fall * narrow * ((1 + stretch) * dx + shear * dy),
        fall * narrow * ((1 - stretch) * dy + shear * dx),
        fall * square,
        -fall * narrow * (dx * dx - dy * dy) / 2,
        -fall * narrow * dx * dy,
        -light * power * np.log(square) * exponent / 2,
        np.ones_like(x),
        x - centre[0],
        y - centre[1],
    )
    return light + level + across * terms[-2] + down * terms[-1], np.stack(terms, axis=1)


def _jackknife(
    tiles: Float64[np.ndarray, "pixels 2"],
    left: Float64[np.ndarray, " pixels"],
    slopes: Float64[np.ndarray, "pixels values"],
) -> Float64[np.ndarray, " values"]:
    """Return the variances of the fitted values, from what these move by where the pixels of a tile are left out.

    What the profile leaves unexplained is much the same at neighbouring pixels, so that whole tiles are left out.
    """
    normal = slopes.T @ slopes
    squares = np.zeros(slopes.shape[1])
    for tile in np.unique(tiles, axis=0):
        inside = (tiles == tile).all(axis=1)
        rest = normal - slopes[inside].T @ slopes[inside]
        squares += np.linalg.lstsq(rest, -slopes[inside].T @ left[inside], rcond=None)[0] ** 2
    return squares


@dataclass(frozen=True, slots=True, kw_only=True)
class QuickSpot:
    """A spot in one image, found within a millisecond: its middle is some 0.1 px off that of a `LaserSpot`."""

    x_px: float
    y_px: float
    """``x_px`` and ``y_px``: centroid of what exceeds half of its height."""
    counts: float
    """Its height over its surroundings."""


def quick_spot(
    image: UInt8[np.ndarray, "rows columns"], *, dark: UInt8[np.ndarray, "rows columns"]
) -> QuickSpot | None:
    """Find the laser spot in a part of one image; None if there is none, or another place is as bright.

    ``dark``: the same part of the scene with the laser off.
    """
    cv2 = opencv(_PURPOSE)
    light = cv2.GaussianBlur(image.astype(np.float32) - dark, (0, 0), _BLUR_PX)
    light -= np.median(light)
    scatter = float(np.median(np.abs(light))) / 0.6745
    peak = float(light.max())
    if not peak > max(_NOISE_SIGMAS * scatter, MIN_COUNTS):
        return None
    count, labels = cv2.connectedComponents((light > SECOND_SHARE * peak).astype(np.uint8), connectivity=8)
    rows, columns = np.nonzero(labels)
    # One place, which is not cut off.
    inside = rows.min() > 0 and rows.max() < len(light) - 1 and columns.min() > 0 and columns.max() < light.shape[1] - 1
    if count != 2 or not inside:
        return None
    weights = light[rows, columns] - SECOND_SHARE * peak
    return QuickSpot(
        x_px=float(weights @ columns / weights.sum()), y_px=float(weights @ rows / weights.sum()), counts=peak
    )


LIT_SHARE = 0.5
"""Least light of an image over that of the brightest one."""

MIN_LIGHT_COUNTS = 6.0
"""Least light over the images with the laser off, in counts of 255, smoothed."""

_LIT_BLUR_PX = 0.75
"""Standard deviation of the smoothing, in pixels of an image of half the size, which is four times as fast."""


def lit_pairs(pairs: Sequence[StereoPair], dark: Sequence[StereoPair]) -> tuple[list[StereoPair], list[StereoPair]]:
    """Return the pairs in which at least one camera saw the laser's light, and those in which none did.

    The laser blinks: at its spot no pair is between bright and dark. Where a highlight moves by, pairs are.

    Parameters
    ----------
    pairs
        Pairs taken while the laser fired, lit or not.
    dark
        Pairs of the same scene with the laser off; at least one.
    """
    if not pairs or not dark:
        return [], list(pairs)
    left = _blinking([pair.left for pair in pairs], [pair.left for pair in dark])
    right = _blinking([pair.right for pair in pairs], [pair.right for pair in dark])
    # What one camera shows beside a place that blinks more in the other one is no laser.
    blinks = max(left.step, right.step)
    light = np.max([each.light for each in (left, right) if each.step >= LIT_SHARE * blinks], axis=0)
    least = max(LIT_SHARE * float(light.max()), MIN_LIGHT_COUNTS)
    lit = [pair for pair, counts in zip(pairs, light, strict=True) if counts >= least]
    return lit, [pair for pair, counts in zip(pairs, light, strict=True) if counts < least]


_MIN_CHANGES = 3
"""Fewest changes between bright and dark of a pixel that blinks: a highlight that passes by makes two."""

_BLINK_SHARE = 0.25
"""Least gap of such a pixel over the widest one: highlights are brighter than the spot of a laser, but not by more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Blinking:
    """The place of one camera's images that blinks most."""

    step: float
    """From the brightest image that is dark there to the darkest one that is lit, in counts."""
    light: Float32[np.ndarray, " images"]
    """How much brighter each image is around it than with the laser off, in counts."""


def _blinking(
    images: Sequence[UInt8[np.ndarray, "rows columns"]], dark: Sequence[UInt8[np.ndarray, "rows columns"]]
) -> _Blinking:
    """Find where images blink: the widest gap between the counts of one pixel in all of them.

    The laser goes on and off; a highlight that moves comes to a pixel, or leaves it, or both. So a pixel that changes
    more often goes before one with a wider gap, if its own is no small part of that.
    """
    off = np.max([_halved(image) for image in dark], axis=0)
    light = np.stack([_halved(image) - off for image in images])
    rows, columns = np.nonzero(light.max(axis=0) >= MIN_LIGHT_COUNTS)
    if not rows.size:
        return _Blinking(step=0.0, light=light.max(axis=(1, 2)))
    counts = np.maximum(light[:, rows, columns], 0.0)
    ordered = np.sort(counts, axis=0)
    gaps = np.diff(ordered, axis=0, prepend=0.0)
    widest = gaps.argmax(axis=0)
    pixels = np.arange(rows.size)
    steps = gaps[widest, pixels]
    changes = np.count_nonzero(np.diff(counts >= ordered[widest, pixels], axis=0), axis=0)
    blinking = (changes >= _MIN_CHANGES) & (steps >= max(MIN_LIGHT_COUNTS, _BLINK_SHARE * float(steps.max())))
    if not blinking.any():
        blinking = np.ones(rows.size, dtype=bool)
    most = int(np.argmax(np.where(blinking, steps, 0.0)))
    # Half of the widest spot, in pixels of half the size: between two images the spot may move a little.
    half = MAX_SIZE_PX // 4
    around = blinking & (np.abs(rows - rows[most]) <= half) & (np.abs(columns - columns[most]) <= half)
    return _Blinking(step=float(steps[most]), light=counts[:, around].max(axis=1))


def _halved(image: UInt8[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "half_rows half_columns"]:
    """Return the image at half its size, the mean of each four pixels, smoothed."""
    cv2 = opencv(_PURPOSE)
    half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(half.astype(np.float32), (0, 0), _LIT_BLUR_PX))
