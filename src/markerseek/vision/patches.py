"""Small parts of an image, found again in another one to a fraction of a pixel whatever the brightness.

The inverse compositional algorithm of S. Baker and I. Matthews ("Lucas-Kanade 20 years on", Int. J. Comput. Vis. 56,
2004, section 3.2): the derivatives are those of the patch, computed once. Gain and offset of the brightness are
projected out of them (part 3 of the same series). The form of a patch in the other image, an affine map, is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float64, UInt8

_STEPS = 12
"""Most steps; three to five are usual."""

_SMALL_PX = 0.01
"""A step with which the search for a patch ends."""

_FULL_COUNTS = 250
"""Brightness from which a pixel counts as saturated: a highlight."""

_WHITE_SHARE = 0.04
"""Largest share of saturated pixels of a patch that is used."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patches:
    """Square parts of an image, of zero mean and unit norm, and what their derivatives say."""

    values: Float64[np.ndarray, "patches side side"]
    slopes: Float64[np.ndarray, "patches 2 side side"]
    """Derivatives by x and y, without what a change of gain or offset would look like."""
    inverse: Float64[np.ndarray, "patches 2 2"]
    """Inverse of the sums of their products, in px²."""
    contrast_counts: Float64[np.ndarray, " patches"]
    """Standard deviation of the brightness."""

    def __getitem__(self, which: np.ndarray) -> Patches:
        """Return some of the patches."""
        return Patches(
            values=self.values[which],
            slopes=self.slopes[which],
            inverse=self.inverse[which],
            contrast_counts=self.contrast_counts[which],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundPatches:
    """Where patches were found."""

    places_px: Float64[np.ndarray, "patches 2"]
    covariances_px2: Float64[np.ndarray, "patches 2 2"]
    """From what is left between patch and image."""
    likeness: Float64[np.ndarray, " patches"]
    """Correlation of patch and image; −1 for a patch that left the image, lies on a highlight, or was not found."""


def cut_patches(
    image: UInt8[np.ndarray, "rows columns"], places_px: Float64[np.ndarray, "patches 2"], *, half: int
) -> Patches:
    """Return the patches of 2 ``half`` + 1 pixels around places (x, y), which lie half + 2 pixels inside the image."""
    reach = np.arange(-half - 1, half + 2, dtype=np.float64)
    wide = np.empty((len(places_px), len(reach), len(reach)))
    _sample(image, places_px, wide)
    inner = wide[:, 1:-1, 1:-1]
    contrast = np.maximum(inner.std(axis=(1, 2)), 1e-3)
    scale = (contrast * inner[0].size ** 0.5)[:, None, None] if len(places_px) else np.ones((0, 1, 1))
    values = (inner - inner.mean(axis=(1, 2), keepdims=True)) / scale
    across = (wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]) / 2 / scale
    down = (wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]) / 2 / scale
    slopes = np.stack([across, down], axis=1)
    slopes -= slopes.mean(axis=(2, 3), keepdims=True)
    slopes -= np.einsum("nkij,nij->nk", slopes, values)[:, :, None, None] * values[:, None]
    sums = np.einsum("nkij,nlij->nkl", slopes, slopes)
    # A patch without texture keeps a covariance of many pixels.
    sums += 1e-6 * np.eye(2)
    return Patches(values=values, slopes=slopes, inverse=np.linalg.inv(sums), contrast_counts=contrast)


def find_patches(
    patches: Patches,
    image: UInt8[np.ndarray, "rows columns"],
    places_px: Float64[np.ndarray, "patches 2"],
    forms: Float64[np.ndarray, "patches 2 2"],
    *,
    reach_px: float,
) -> FoundPatches:
    """Find patches in an image.

    Parameters
    ----------
    patches
        Patches of another image.
    image
        The image in which they are looked for.
    places_px
        Where each is expected.
    forms
        Displacement in the image by one pixel to the right and one down in the patch: columns of the affine map.
    reach_px
        Farthest place from the expected one.
    """
    places = places_px.copy()
    likeness = np.full(len(places), -1.0)
    _align(patches.values, patches.slopes, patches.inverse, image, forms, reach_px, places, likeness)
    # Values have unit norm, so that the squared difference is 2 (1 − correlation); neighbouring pixels differ alike.
    left = 2 * np.clip(1 - likeness, 1e-6, None) * _ALIKE_PX / patches.values[0].size if len(places) else likeness
    turned = forms @ (left[:, None, None] * patches.inverse) @ np.swapaxes(forms, 1, 2)
    return FoundPatches(places_px=places, covariances_px2=turned + _FLOOR_PX**2 * np.eye(2), likeness=likeness)


_ALIKE_PX = 6.0
"""Neighbouring pixels whose differences between patch and image are alike."""

_FLOOR_PX = 0.03
"""What interpolation between pixels leaves of an error, however good the texture."""


def best_of(
    patches: Patches,
    image: UInt8[np.ndarray, "rows columns"],
    places_px: Float64[np.ndarray, "patches tried 2"],
) -> tuple[Float64[np.ndarray, " patches"], Float64[np.ndarray, "patches tried"]]:
    """Return the correlations of each patch, upright, at the places that are tried for it, and the largest of them."""
    likeness = np.full(places_px.shape[:2], -1.0)
    _correlate(patches.values, image, places_px, likeness)
    return likeness.max(axis=1), likeness


@compiled
def _sample(
    image: UInt8[np.ndarray, "rows columns"],
    places: Float64[np.ndarray, "patches 2"],
    out: Float64[np.ndarray, "patches side side"],
) -> None:
    """Interpolate an image linearly at the pixels of upright patches that lie inside it."""
    half = out.shape[1] // 2
    for n in range(len(places)):
        column = int(np.floor(places[n, 0]))
        row = int(np.floor(places[n, 1]))
        a = places[n, 0] - column
        b = places[n, 1] - row
        for i in range(out.shape[1]):
            for j in range(out.shape[1]):
                y = row + i - half
                x = column + j - half
                top = (1 - a) * image[y, x] + a * image[y, x + 1]
                low = (1 - a) * image[y + 1, x] + a * image[y + 1, x + 1]
                out[n, i, j] = (1 - b) * top + b * low


@compiled
def _read(
    image: UInt8[np.ndarray, "rows columns"],
    x0: float,
    y0: float,
    form: Float64[np.ndarray, "2 2"],
    most_white: float,
    out: Float64[np.ndarray, "side side"],
) -> bool:
    """Interpolate the image under an affine patch, to zero mean and unit norm; False where that cannot be done."""
    side = out.shape[0]
    half = side // 2
    rows, columns = image.shape
    # The corners of the patch are those that leave an image first.
    x_reach = (abs(form[0, 0]) + abs(form[0, 1])) * half
    y_reach = (abs(form[1, 0]) + abs(form[1, 1])) * half
    if not (x_reach <= x0 < columns - 1 - x_reach and y_reach <= y0 < rows - 1 - y_reach):
        return False
    total = 0.0
    white = 0
    for i in range(side):
        for j in range(side):
            x = x0 + form[0, 0] * (j - half) + form[0, 1] * (i - half)
            y = y0 + form[1, 0] * (j - half) + form[1, 1] * (i - half)
            column = int(x)
            row = int(y)
            a = x - column
            b = y - row
            nearest = image[row, column]
            white += nearest >= _FULL_COUNTS
            top = nearest + a * (float(image[row, column + 1]) - nearest)
            low = image[row + 1, column] + a * (float(image[row + 1, column + 1]) - image[row + 1, column])
            value = top + b * (low - top)
            out[i, j] = value
            total += value
    if white > most_white * side * side:
        return False
    mean = total / (side * side)
    square = 0.0
    for i in range(side):
        for j in range(side):
            out[i, j] -= mean
            square += out[i, j] * out[i, j]
    if square < side * side * 0.04:
        return False
    scale = 1 / np.sqrt(square)
    for i in range(side):
        for j in range(side):
            out[i, j] *= scale
    return True


@compiled
def _align(
    values: Float64[np.ndarray, "patches side side"],
    slopes: Float64[np.ndarray, "patches 2 side side"],
    inverse: Float64[np.ndarray, "patches 2 2"],
    image: UInt8[np.ndarray, "rows columns"],
    forms: Float64[np.ndarray, "patches 2 2"],
    reach: float,
    places: Float64[np.ndarray, "patches 2"],
    likeness: Float64[np.ndarray, " patches"],
) -> None:
    """Move each place to where the image is most like its patch, and write how like it is there."""
    side = values.shape[1]
    seen = np.empty((side, side))
    for n in range(len(places)):
        x0 = places[n, 0]
        y0 = places[n, 1]
        x = x0
        y = y0
        done = False
        for _ in range(_STEPS):
            # A place that is not finite, or too far away, is none.
            if not (x - x0) * (x - x0) + (y - y0) * (y - y0) <= reach * reach:
                break
            if not _read(image, x, y, forms[n], _WHITE_SHARE, seen):
                break
            if done:
                likeness[n] = _product(seen, values[n])
                break
            # Eq. 31 of the paper: the step of the patch. The image moves the other way.
            seen -= values[n]
            across = _product(slopes[n, 0], seen)
            down = _product(slopes[n, 1], seen)
            du = inverse[n, 0, 0] * across + inverse[n, 0, 1] * down
            dv = inverse[n, 1, 0] * across + inverse[n, 1, 1] * down
            dx = forms[n, 0, 0] * du + forms[n, 0, 1] * dv
            dy = forms[n, 1, 0] * du + forms[n, 1, 1] * dv
            x -= dx
            y -= dy
            done = dx * dx + dy * dy < _SMALL_PX * _SMALL_PX
        places[n, 0] = x
        places[n, 1] = y


@compiled
def _product(first: Float64[np.ndarray, "side side"], second: Float64[np.ndarray, "side side"]) -> float:
    """Return the sum of the products of all pixels."""
    total = 0.0
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            total += first[i, j] * second[i, j]
    return total


@compiled
def _correlate(
    values: Float64[np.ndarray, "patches side side"],
    image: UInt8[np.ndarray, "rows columns"],
    places: Float64[np.ndarray, "patches tried 2"],
    likeness: Float64[np.ndarray, "patches tried"],
) -> None:
    """Write the correlation of each upright patch with the image at each place that is tried."""
    side = values.shape[1]
    seen = np.empty((side, side))
    upright = np.eye(2)
    for n in range(places.shape[0]):
        for k in range(places.shape[1]):
            if not _read(image, places[n, k, 0], places[n, k, 1], upright, 1.0, seen):
                continue
            likeness[n, k] = _product(seen, values[n])
