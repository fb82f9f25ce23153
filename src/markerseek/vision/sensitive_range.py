"""The sensitive range: by how many degrees the probe may be turned off an instrument's tip that it still shows.

A tip is bright beside its surroundings in the image, and only near one angle of the probe; layers of the tissue are
as bright beside one another, and shadows are there at all angles. Grey values are logarithms of the echo, so that
speckle has the same standard deviation everywhere, `SPECKLE_DB` of a Rayleigh distributed amplitude: with it, grey
values become decibels whatever the machine's dynamic range is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64, UInt8
from markerseek.vision.images import LARGEST_PX, Rectangle, opencv

GONE_FRAMES = 2
"""Frames in a row without the tip after which it has disappeared."""

SPECKLE_DB = 5.57
"""Standard deviation of the level of fully developed speckle in dB (10 π / (ln 10 √6))."""

LEAST_CONTRAST = 1.6
LEAST_NAMED_CONTRAST = 1.0
"""Least excess of a tip over its surroundings, in standard deviations of the speckle: anywhere, and in a rectangle that
a person names. Chosen on the development scans of ``benchmarks/tooltip``."""

WHITE_SHARE = 0.1
"""Share of white pixels from which images are refused."""

LEAST_TISSUE = 0.02
"""Least share of an image that shows tissue with speckle."""

_WHITE = 255
_NEAR_WHITE = 238
_BESIDE_M = (3.4e-3, 6.5e-3)
"""Distances along the array, from the middle of a tip, between which its surroundings are looked at."""
_SMOOTH_M = (1e-3, 0.5e-3)
"""Standard deviations in depth and along the array of the blur under which a tip is looked for."""
_FACE_M = (0.4e-3, 1.0e-3)
"""Half the height and half the width of the area over which the tip's echo is averaged."""
_UNEVEN_M = 0.7e-3
"""How far the surface of the tissue may be higher or lower beside the tip."""
_TAIL_M = 16e-3
"""The tip is looked for within this of the place that stands out most, which may lie in the tail behind the tip."""
_GRAIN_DB = 3.0
"""By how much the brightest image may exceed the first or last one, if the scan begins or ends at the tip."""
_SMALLEST_PX = 16
"""Fewest rows or columns of an image."""
PURPOSE = "finding the tip of an instrument"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tip:
    """What is known of the tip after one image."""

    visible: bool
    """Whether the tip is seen."""
    intensity: float
    """Grey value of the tip."""
    level: float
    """Grey value that it must exceed."""
    row: float
    column: float
    """``row`` and ``column``: its centroid in pixels; the middle of the rectangle where no region was found."""
    area_px: int
    """Pixels of its region."""
    rectangle: Rectangle
    """Where it was looked for."""
    reason: str = ""
    """Why it is seen or not, in words."""
    rivals: int = 0
    """Other bright regions in the rectangle."""
    cut_off: bool = False
    """Whether its region reaches the edge of the image, so that its centroid is that of a part."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TipFrame:
    """The tip in one image of a series."""

    angle_deg: float
    tip: Tip | None
    """None if it is not looked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitiveRange:
    """Sensitive range of one tip."""

    frames: tuple[TipFrame, ...]
    """All images, in the order of their angles."""
    reference_deg: float | None
    """Angle of the brightest tip; None if no image shows one."""
    below_deg: float | None = None
    above_deg: float | None = None
    """``below_deg`` and ``above_deg``: half of the range on either side of it; None if no image lies there."""
    open_below: bool = False
    open_above: bool = False
    """``open_below`` and ``open_above``: whether the images of that side end before the tip has disappeared: its half
    is then at least this."""
    remark: str = ""
    """What a person should know of the images; empty if there is nothing."""

    @property
    def half_deg(self) -> float | None:
        """Half of the range in degrees: of one side, or the mean of both; None if there is no tip."""
        sides = [side for side in (self.below_deg, self.above_deg) if side is not None]
        return sum(sides) / len(sides) if sides else None

    @property
    def full_deg(self) -> float | None:
        """The whole range in degrees; a side that was not recorded is taken to equal the other, as in the paper."""
        half = self.half_deg
        return None if half is None else 2 * half


def sensitive_range(
    angles_deg: Sequence[float],
    images: Sequence[UInt8[np.ndarray, "rows columns"]],
    *,
    pixel_m: tuple[float, float],
    rectangle: Rectangle | None = None,
) -> SensitiveRange:
    """Find the tip in the images of a scan, and the angles between which its echo exceeds that of its surroundings.

    The tip is lost where its echo has fallen to the power of the echo around it, so that both together have twice that
    power.

    ``images``: grey values, all of one shape. ``pixel_m``: height and width of a pixel. ``rectangle``: where the tip is
    looked for; None: everywhere but within 4 mm of the sides and 2 mm of the ends.
    """
    order = angular_order(angles_deg, images)
    angles = np.array([float(angles_deg[index]) for index in order])
    stack = np.stack([images[index] for index in order])
    part = None if rectangle is None else rectangle.within(stack.shape[1:])
    if (white := float(np.mean(stack == _WHITE))) > WHITE_SHARE:
        return no_tip(angles, f"the images are saturated, {white:.0%} of their pixels are white; lower the gain")
    speckle = _speckle_deviation(stack, pixel_m)
    if speckle is None:
        return no_tip(angles, "no tip: the images show no tissue with speckle, in which a tip could be seen")
    contrast = _contrast(stack, pixel_m, part) / speckle
    row, column = (int(each) for each in np.unravel_index(int(np.argmax(contrast.max(axis=0))), stack.shape[1:]))
    strength = contrast[:, :, column].max(axis=1)
    least = LEAST_CONTRAST if part is None else LEAST_NAMED_CONTRAST
    if strength.max() < least:
        return no_tip(
            angles,
            f"no tip: nothing stands out near one angle only; the brightest place exceeds its surroundings by "
            f"{max(0.0, strength.max()):.1f} standard deviations of the speckle, {least:g} are needed",
        )
    row = _row_of_tip(stack, strength, pixel_m, row, column, part)
    level_db, needed_db = _levels(stack, speckle, pixel_m, row, column)
    return _measured(angles, level_db, needed_db, speckle, pixel_m, (row, column), stack.shape[1:])


def no_tip(angles_deg: Sequence[float] | Float64[np.ndarray, " images"], remark: str) -> SensitiveRange:
    """Return the answer where there is no tip."""
    return SensitiveRange(
        frames=tuple(TipFrame(angle_deg=float(angle_deg), tip=None) for angle_deg in angles_deg),
        reference_deg=None,
        remark=remark,
    )


def _speckle_deviation(stack: UInt8[np.ndarray, "images rows columns"], pixel_m: tuple[float, float]) -> float | None:
    """Return the median standard deviation of the grey values in windows of 2.5 mm that are neither black nor white."""
    cv2 = opencv(PURPOSE)
    window = (max(3, round(2.5e-3 / pixel_m[1])), max(3, round(2.5e-3 / pixel_m[0])))
    found = []
    for image in stack:
        grey = image.astype(np.float32)
        mean = cv2.blur(grey, window)
        variance = cv2.blur(grey * grey, window) - mean * mean
        white, black = (cv2.blur(each.astype(np.float32), window) for each in (image >= 254, image <= 1))
        tissue = (white < 0.01) & (black < 0.1) & (mean > 8) & (variance > 1)
        if np.mean(tissue) > LEAST_TISSUE:
            found.append(float(np.median(np.sqrt(np.maximum(variance[tissue], 0)))))
    deviation = float(np.median(found)) if 2 * len(found) > len(stack) else 0.0
    return deviation or None


def _contrast(
    stack: UInt8[np.ndarray, "images rows columns"], pixel_m: tuple[float, float], part: Rectangle | None
) -> Float64[np.ndarray, "images rows columns"]:
    """Return the smaller excess of the grey values, over their brighter surroundings or over other angles."""
    cv2 = opencv(PURPOSE)
    down, along = (sigma / size for sigma, size in zip(_SMOOTH_M, pixel_m, strict=True))
    smooth = np.stack([cv2.GaussianBlur(each.astype(np.float32), (0, 0), sigmaX=along, sigmaY=down) for each in stack])
    near, far = (round(distance / pixel_m[1]) for distance in _BESIDE_M)
    columns = stack.shape[2]
    middle = (near + far) // 2
    uneven = np.ones((2 * round(0.3e-3 / pixel_m[0]) + 1, 1))
    # A tip is seen in less than four fifths of a scan.
    found = smooth - np.quantile(smooth, 0.2, axis=0)
    for image, contrast in zip(smooth, found, strict=True):
        usual = np.repeat(np.median(image, axis=1, keepdims=True), far, axis=1)
        beside = cv2.blur(np.concatenate([usual, image, usual], axis=1), (far - near + 1, 1))
        left, right = (beside[:, first : first + columns] for first in (far - middle, far + middle))
        np.minimum(contrast, image - cv2.dilate(np.maximum(left, right), uneven), out=contrast)
    looked = np.zeros(stack.shape[1:], bool)
    if part is not None:
        looked[part.slices] = True
    else:
        # Beside the tip there must be something to compare with.
        side = near + round(1e-3 / pixel_m[1])
        end = round(2e-3 / pixel_m[0])
        looked[end:-end, side:-side] = True
    found[:, ~looked] = -np.inf
    return np.asarray(found, dtype=np.float64)


def _row_of_tip(
    stack: UInt8[np.ndarray, "images rows columns"],
    strength: Float64[np.ndarray, " images"],
    pixel_m: tuple[float, float],
    row: int,
    column: int,
    part: Rectangle | None,
) -> int:
    """Return the row where the tip's columns are brightest, in the three strongest images that are not white."""
    cv2 = opencv(PURPOSE)
    half = max(1, round(0.6e-3 / pixel_m[1]))
    columns = stack[:, :, max(0, column - half) : column + half + 1].mean(axis=2, dtype=np.float32)
    # Rows along the images' second axis.
    profiles = np.vstack(
        [cv2.GaussianBlur(each[None], (0, 0), sigmaX=0.35e-3 / pixel_m[0], sigmaY=0.01) for each in columns]
    )
    strong = [int(k) for k in np.argsort(-strength) if strength[k] > 0.5 * strength.max()]
    clear = [k for k in strong if profiles[k].max() < _NEAR_WHITE] or strong[-1:]
    reach = round(_TAIL_M / pixel_m[0])
    first = max(0, row - reach)
    last = row + reach + 1
    if part is not None:
        first = max(first, part.row)
        last = min(last, part.row + part.rows)
    return first + int(np.argmax(profiles[clear[:3]].mean(axis=0)[first:last]))


def _levels(
    stack: UInt8[np.ndarray, "images rows columns"],
    speckle: float,
    pixel_m: tuple[float, float],
    row: int,
    column: int,
) -> tuple[Float64[np.ndarray, " images"], Float64[np.ndarray, " images"]]:
    """Return the level of the tip's place in each image, and the level that it must exceed; dB below white."""
    # Powers are averaged, as that is what the tip and its surroundings have in common.
    power = 10 ** ((stack.astype(np.float64) - _WHITE) * (SPECKLE_DB / speckle / 10))
    high, wide = (max(1, round(half / size)) for half, size in zip(_FACE_M, pixel_m, strict=True))
    near, far = (round(distance / pixel_m[1]) for distance in _BESIDE_M)
    uneven = round(_UNEVEN_M / pixel_m[0])

    def bands(columns: slice) -> list[Float64[np.ndarray, " images"]]:
        """Return the mean power in bands as high as the face, at each depth that the surface may have."""
        part = power[:, :, columns]
        rows = range(max(high, row - uneven), min(stack.shape[1] - high, row + uneven + 1))
        return [part[:, each - high : each + high + 1].mean(axis=(1, 2)) for each in rows]

    face = power[:, max(0, row - high) : row + high + 1, max(0, column - wide) : column + wide + 1].mean(axis=(1, 2))
    sides = [slice(max(0, column - far), max(0, column - near)), slice(column + near, column + far)]
    beside = [np.max(bands(side), axis=0) for side in sides if len(range(stack.shape[2])[side]) >= 4]
    gone = float(np.sort(face)[: max(2, len(face) // 5)].mean())
    around = np.mean(beside, axis=0) if beside else np.full(len(face), gone)
    if gone < 2 * np.median(around):
        # Otherwise the scan ends before the tip has gone.
        around = np.maximum(around, gone)
    # A white tip counts as seen, whatever is white beside it: how bright both are is not known.
    needed = np.minimum(2 * around, 0.8)
    return 10 * np.log10(face), 10 * np.log10(needed)


def _measured(
    angles: Float64[np.ndarray, " images"],
    level_db: Float64[np.ndarray, " images"],
    needed_db: Float64[np.ndarray, " images"],
    speckle: float,
    pixel_m: tuple[float, float],
    place: tuple[int, int],
    shape: tuple[int, int],
) -> SensitiveRange:
    """Return the range between the angles at which the level falls to what it must exceed."""
    excess = level_db - needed_db
    brightest = np.flatnonzero(level_db > level_db.max() - 0.5)
    start = int(brightest[len(brightest) // 2])
    if excess[start] < 0:
        return no_tip(angles, "no tip: the place that stands out is no brighter than the tissue beside it")
    low, low_deg = _lost(angles, excess, start, -1)
    high, high_deg = _lost(angles, excess, start, 1)
    if low_deg is not None and high_deg is not None:
        top = (low_deg + high_deg) / 2
    elif level_db[end := 0 if low_deg is None else -1] > level_db.max() - _GRAIN_DB:
        # As in the paper, whose scans begin where the tip is brightest.
        top = float(angles[end])
    else:
        top = _vertex(angles[low : high + 1], level_db[low : high + 1])
    reference = low + int(np.argmin(np.abs(angles[low : high + 1] - top)))
    centre = float(angles[reference]) if low_deg is None or high_deg is None else top
    half_rows, half_columns = (max(1, round(half / size)) for half, size in zip(_FACE_M, pixel_m, strict=True))
    face = Rectangle(
        row=place[0] - half_rows, column=place[1] - half_columns, rows=2 * half_rows + 1, columns=2 * half_columns + 1
    ).within(shape)
    to_grey = speckle / SPECKLE_DB
    frames = tuple(
        TipFrame(
            angle_deg=float(angle_deg),
            tip=Tip(
                visible=low <= k <= high,
                intensity=max(0.0, 255 + to_grey * float(level_db[k])),
                level=max(0.0, 255 + to_grey * float(needed_db[k])),
                row=float(place[0]),
                column=float(place[1]),
                area_px=face.rows * face.columns,
                rectangle=face,
            ),
        )
        for k, angle_deg in enumerate(angles)
    )
    return SensitiveRange(
        frames=frames,
        reference_deg=float(angles[reference]),
        below_deg=_side(centre, low_deg, float(angles[0]), closed=high_deg is not None),
        above_deg=_side(centre, high_deg, float(angles[-1]), closed=low_deg is not None),
        open_below=low_deg is None and high_deg is None,
        open_above=low_deg is None and high_deg is None,
    )


def _side(centre_deg: float, lost_deg: float | None, end_deg: float, *, closed: bool) -> float | None:
    """Return half of the range on one side; None if the images end before, and the other side is known."""
    if lost_deg is not None:
        return abs(lost_deg - centre_deg)
    return None if closed or end_deg == centre_deg else abs(end_deg - centre_deg)


def _lost(
    angles: Float64[np.ndarray, " images"], excess: Float64[np.ndarray, " images"], start: int, step: int
) -> tuple[int, float | None]:
    """Return the last image of one side that shows the tip, and the angle at which it is lost.

    None beyond the images.
    """
    last = start
    k = start + step
    gone = 0
    while 0 <= k < len(angles) and gone < GONE_FRAMES:
        last, gone = (k, 0) if excess[k] >= 0 else (last, gone + 1)
        k += step
    if gone == 0:
        return last, None
    share = float(excess[last] / (excess[last] - excess[last + step]))
    return last, float(angles[last] + share * (angles[last + step] - angles[last]))


def _vertex(angles: Float64[np.ndarray, " images"], level_db: Float64[np.ndarray, " images"]) -> float:
    """Return the angle at which a parabola through the levels is highest, within these angles."""
    if len(angles) < 4:
        return float(angles[int(np.argmax(level_db))])
    square, slope, _ = np.polyfit(angles - angles[0], level_db, 2)
    if square >= 0:
        return float(angles[int(np.argmax(level_db))])
    return float(np.clip(angles[0] - slope / (2 * square), angles[0], angles[-1]))


def angular_order(angles_deg: Sequence[float], images: Sequence[np.ndarray]) -> list[int]:
    """Return the order of the images by angle."""
    if len(images) != len(angles_deg):
        raise ConfigError(f"sensitive range: {len(angles_deg)} angles for {len(images)} images; give one for each")
    if len(images) < 2:
        raise ConfigError(f"sensitive range: {len(images)} image, at least 2 are needed, at different angles")
    for number, (angle_deg, image) in enumerate(zip(angles_deg, images, strict=True), start=1):
        if not math.isfinite(angle_deg):
            raise ConfigError(f"sensitive range: the angle of image {number} is {angle_deg} deg, it must be finite")
        require_image(image)
        if image.shape != images[0].shape:
            raise ConfigError(
                f"sensitive range: image {number} has {image.shape[0]} × {image.shape[1]} pixels, the first has "
                f"{images[0].shape[0]} × {images[0].shape[1]}; keep images of one scan in a folder"
            )
    if len(set(angles_deg)) < len(angles_deg):
        raise ConfigError("sensitive range: two images have the same angle; leave one of them out")
    return sorted(range(len(images)), key=lambda index: angles_deg[index])


def require_image(image: UInt8[np.ndarray, "rows columns"]) -> None:
    """Refuse an image that is no grey one, or too small or large; `ConfigError`."""
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ConfigError(
            f"B-mode image: it is {image.dtype} of shape {image.shape}, uint8 of (rows, columns) is needed"
        )
    if not _SMALLEST_PX <= min(image.shape) <= max(image.shape) <= LARGEST_PX:
        raise ConfigError(
            f"B-mode image: {image.shape[0]} × {image.shape[1]} pixels, {_SMALLEST_PX} to {LARGEST_PX} are needed in "
            "each direction"
        )
