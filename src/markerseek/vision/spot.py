"""The laser spot in the images of one camera: its pixel with a standard deviation, or that there is none, or two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from markerseek.core import ConfigError, Float32, Float64, UInt8
from markerseek.vision.opencv import opencv

MOST_SIZE_PX = 61
"""Widest spot in pixels: what is wider, such as tissue lit by the endoscope, counts as background."""

LEAST_COUNTS = 12.0
"""Least height of a spot over its surroundings, in counts of 255."""

NOISE_SIGMAS = 8.0
"""Least height over the scatter of the image, in standard deviations; highlights on wet tissue have long tails."""

SECOND_SHARE = 0.5
"""Height of another bright place over that of the brightest, from which the two cannot be told apart."""

LEAST_SHARE = 0.6
"""Least share of the frames that must show the spot."""

MOST_MOTION_PX = 2.0
"""Largest scatter of the spot from frame to frame, in pixels: more is motion, and no mean would be right."""

_BLUR_PX = 1.5
"""Standard deviation of the smoothing before the brightest place is searched, in pixels."""

_BORDER_PX = 6
"""Width of the border of a window around the spot that shows its background, in pixels."""

_CORE_SHARE = 0.4
"""Share of the peak below which a pixel does not count for the centroid, so that the background does not pull at it."""


_PURPOSE = "finding the laser spot in camera images"


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserSpot:
    """The laser spot.

    Attributes
    ----------
    x_px, y_px
        Mean over the frames of the centroid, in pixels from the centre of the first pixel.
    sigma_px
        Standard deviation of that mean, from the scatter of the frames (root mean square of both directions), in
        pixels; None with fewer than three frames.
    frames
        Number of frames that show it.
    """

    x_px: float
    y_px: float
    sigma_px: float | None
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NoSpot:
    """There is no spot that can be measured, and why."""

    reason: str


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

    Parameters
    ----------
    frames
        Images with the laser on, shape (rows, columns) or (rows, columns, 3), 8 bits.
    dark
        Images of the same scene with the laser off; their mean is subtracted, and highlights with it.

    Raises
    ------
    ConfigError
        If there is no frame, or their shapes differ.
    MissingExtraError
        If OpenCV is not installed.
    """
    _require_alike([*frames, *dark])
    gray = [_gray(frame) for frame in frames]
    background = np.mean([_gray(frame) for frame in dark], axis=0, dtype=np.float32) if dark else np.float32(0)
    mean = np.asarray(np.mean(gray, axis=0, dtype=np.float32) - background)
    height = _height(mean)
    middle = float(np.median(height))
    # The median deviation of Gaussian noise is 0.6745 of its standard deviation.
    scatter = float(np.median(np.abs(height - middle))) / 0.6745
    level = max(middle + NOISE_SIGMAS * scatter, LEAST_COUNTS)
    row, column = np.unravel_index(int(np.argmax(height)), height.shape)
    peak = float(height[row, column])
    if not peak > level:
        return NoSpot(
            reason=f"no spot: the brightest place is {peak:.1f} counts over its surroundings, {level:.1f} are needed; "
            "check that the laser is on and in view, and that the camera does not block infrared light"
        )
    first = (int(column), int(row))
    second = _second(height, first, level=max(level, SECOND_SHARE * peak))
    if second is not None:
        return TwoSpots(places_px=((float(first[0]), float(first[1])), second))
    return _centroids([frame - background for frame in gray], first, least=LEAST_SHARE * peak)


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
        if min(image.shape[:2]) < 2 * MOST_SIZE_PX:
            raise ConfigError(
                f"camera frame {number} has the shape {image.shape}, at least {2 * MOST_SIZE_PX} pixels are needed in "
                "both directions"
            )


def _gray(image: UInt8[np.ndarray, " ..."]) -> Float32[np.ndarray, "rows columns"]:
    """Brightness: the brightest channel, because a camera shows 785 nm in one or two of its three."""
    return (image if image.ndim == 2 else image.max(axis=2)).astype(np.float32)


def _height(image: Float32[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "rows columns"]:
    """Height over the surroundings: a white top-hat, which removes all that is wider than its kernel."""
    cv2 = opencv(_PURPOSE)
    smooth = cv2.GaussianBlur(image, (0, 0), _BLUR_PX)
    kernel = cv2.getStructuringElement(cv2.MORPH_RECT, (MOST_SIZE_PX, MOST_SIZE_PX))
    height: Float32[np.ndarray, "rows columns"] = cv2.morphologyEx(smooth, cv2.MORPH_TOPHAT, kernel)
    return height


def _second(
    height: Float32[np.ndarray, "rows columns"], first: tuple[int, int], *, level: float
) -> tuple[float, float] | None:
    """Brightest place above a level that is not connected with the first; None if there is none."""
    cv2 = opencv(_PURPOSE)
    _, labels = cv2.connectedComponents((height > level).astype(np.uint8), connectivity=8)
    other = np.where((labels > 0) & (labels != labels[first[1], first[0]]), height, 0)
    row, column = np.unravel_index(int(np.argmax(other)), other.shape)
    return (float(column), float(row)) if other[row, column] > 0 else None


def _centroids(
    frames: list[Float32[np.ndarray, "rows columns"]], first: tuple[int, int], *, least: float
) -> SpotAnswer:
    """Mean and scatter of the centroids of the frames that show the spot."""
    places = [place for frame in frames if (place := _centroid(frame, first, least=least)) is not None]
    if len(places) < LEAST_SHARE * len(frames):
        return NoSpot(
            reason=f"the spot is seen in {len(places)} of {len(frames)} frames, {LEAST_SHARE:.0%} are needed; keep the "
            "laser on while the camera records"
        )
    x_px, y_px = np.mean(places, axis=0).tolist()
    if len(places) < 3:
        return LaserSpot(x_px=x_px, y_px=y_px, sigma_px=None, frames=len(places))
    scatter_px = float(np.sqrt(np.mean(np.var(places, axis=0, ddof=1))))
    if not scatter_px <= MOST_MOTION_PX:
        return NoSpot(
            reason=f"the spot moves by {scatter_px:.1f} px from frame to frame, {MOST_MOTION_PX:g} px is the limit; "
            "hold camera and laser still"
        )
    # A rounded centroid of identical frames would have no scatter at all.
    sigma_px = max(scatter_px, 0.01) / float(np.sqrt(len(places)))
    return LaserSpot(x_px=x_px, y_px=y_px, sigma_px=sigma_px, frames=len(places))


def _centroid(
    frame: Float32[np.ndarray, "rows columns"], first: tuple[int, int], *, least: float
) -> Float64[np.ndarray, " 2"] | None:
    """Centroid (x, y) of the spot near a place in one frame; None if it is fainter than a least height there."""
    half = MOST_SIZE_PX // 2
    column, row = first
    top, left = max(0, row - half), max(0, column - half)
    window = frame[top : row + half + 1, left : column + half + 1]
    height = window - _plane(window)
    peak = float(height.max())
    if not peak >= least:
        return None
    weight = np.maximum(height - _CORE_SHARE * peak, 0).astype(np.float64)
    # Only pixels connected with the brightest: single bright pixels of noise would pull at the centroid.
    _, labels = opencv(_PURPOSE).connectedComponents((weight > 0).astype(np.uint8), connectivity=8)
    brightest = np.unravel_index(int(np.argmax(weight)), weight.shape)
    weight[labels != labels[brightest]] = 0
    rows, columns = np.indices(weight.shape)
    middle = np.array([np.sum(weight * columns), np.sum(weight * rows)]) / weight.sum()
    return np.asarray(middle + np.array([left, top]))


def _plane(window: Float32[np.ndarray, "rows columns"]) -> Float64[np.ndarray, "rows columns"]:
    """Background of a window: the plane through its border. Uneven light would pull the centroid by 0.1 px."""
    rows, columns = np.indices(window.shape)
    edge = np.ones(window.shape, dtype=bool)
    edge[_BORDER_PX:-_BORDER_PX, _BORDER_PX:-_BORDER_PX] = False
    terms = np.stack([np.ones(window.shape), columns, rows], axis=2)
    plane = np.linalg.lstsq(terms[edge], window[edge].astype(np.float64), rcond=None)[0]
    return np.asarray(terms @ plane)
