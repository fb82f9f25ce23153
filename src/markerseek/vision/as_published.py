"""The tip and its sensitive range as in section 2.5 D of the paper: GrabCut, region, centroid, its grey value.

GrabCut (C. Rother et al., ACM Trans. Graph. 23, 309 (2004)) separates an object in a rectangle from what is around it.
It answers in every image, also if there is no tip, so that two tests follow: the region has at least `MIN_PX` pixels,
and its centroid is brighter than tissue at the same depth beside the rectangle, by `_SIGMAS` of its deviations.

From the reference, where the tip is brightest, the probe is turned in even steps until the tip has disappeared; what
lies between the two is half of the range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from markerseek.core import ConfigError, Float64, UInt8
from markerseek.vision.images import Rectangle, opencv
from markerseek.vision.sensitive_range import (
    GONE_FRAMES,
    PURPOSE,
    SensitiveRange,
    Tip,
    TipFrame,
    angular_order,
    no_tip,
    require_image,
)

MIN_PX = 20
"""Fewest pixels of a tip."""

_SIGMAS = 3.0
"""Standard deviations of the tissue's grey values by which the tip's centroid exceeds their mean."""

GROWN_M = 3e-3
"""How far a rectangle reaches beyond the bright region that it is put around, in metres."""

RIVAL_SHARE = 0.5
"""A second region counts as another tip if its grey values add up to this share of the first one's."""

_AROUND_M = 6e-3
"""Width of the surroundings of a rectangle that GrabCut is shown, and in which tissue is looked for, in metres."""

_BLUR_M = 0.7e-3
"""Standard deviation of the blur under which the brightest region is found: speckle is finer than this."""

_SMOOTH_M = 0.3e-3
"""Standard deviation of the blur under which GrabCut works, about the size of speckle; intensities are not blurred."""

_TISSUE_SHARE = 0.95
_ROUNDS = 5
_SEED = 1


def published_sensitive_range(
    angles_deg: Sequence[float],
    images: Sequence[UInt8[np.ndarray, "rows columns"]],
    *,
    pixel_m: tuple[float, float],
    rectangle: Rectangle | None = None,
) -> SensitiveRange:
    """Follow the tip from the image in which it is brightest to either side, and measure how far it is seen.

    ``images``: grey values, all of one shape. ``pixel_m``: height and width of a pixel. ``rectangle``: where the tip is
    in the image of the reference; None: around the brightest region of all images.
    """
    order = angular_order(angles_deg, images)
    angles = [float(angles_deg[index]) for index in order]
    blobs = [brightest_blob(images[index], pixel_m=pixel_m, inside=rectangle) for index in order]
    start = int(np.argmax([top for _, top in blobs]))
    first = rectangle or blobs[start][0]
    tips: dict[int, Tip] = {start: find_tip(images[order[start]], first, pixel_m=pixel_m)}
    # A wall or bone that the image shows in part can be brighter than any tip; what a person names is taken.
    cut_off = rectangle is None and tips[start].cut_off
    if cut_off:
        edge = "the region reaches the edge of the image; name the rectangle around the tip"
        tips[start] = replace(tips[start], visible=False, reason=edge)
    if not tips[start].visible:
        nothing = no_tip(angles, f"no tip in the brightest image, at {angles[start]:g} deg: {tips[start].reason}")
        frames = tuple(TipFrame(angle_deg=angle, tip=tips.get(k)) for k, angle in enumerate(angles))
        return replace(nothing, frames=frames)
    for side in (range(start + 1, len(order)), range(start - 1, -1, -1)):
        tips |= _followed(images, order, side, tips[start], first, pixel_m)
    visible = [k for k, tip in tips.items() if tip.visible]
    reference = max(visible, key=lambda k: (tips[k].intensity, -abs(k - start)))
    low = min(visible)
    high = max(visible)
    rivals = [angles[k] for k in sorted(visible) if tips[k].rivals]
    return SensitiveRange(
        frames=tuple(TipFrame(angle_deg=angle, tip=tips.get(k)) for k, angle in enumerate(angles)),
        reference_deg=angles[reference],
        below_deg=angles[reference] - angles[low] if reference > 0 else None,
        above_deg=angles[high] - angles[reference] if reference < len(order) - 1 else None,
        open_below=reference > 0 and low < GONE_FRAMES,
        open_above=reference < len(order) - 1 and len(order) - 1 - high < GONE_FRAMES,
        remark=_remark(rivals),
    )


def _followed(
    images: Sequence[np.ndarray],
    order: Sequence[int],
    side: range,
    tip: Tip,
    rectangle: Rectangle,
    pixel_m: tuple[float, float],
) -> dict[int, Tip]:
    """Return the tip in the images of one side, until it has disappeared."""
    found: dict[int, Tip] = {}
    gone = 0
    for k in side:
        # Carried along with the tip: its depth changes as the probe turns.
        found[k] = find_tip(images[order[k]], rectangle.centred(tip.row, tip.column), pixel_m=pixel_m)
        if found[k].visible:
            tip = found[k]
            gone = 0
            continue
        gone += 1
        if gone == GONE_FRAMES:
            break
    return found


def _remark(rivals_deg: Sequence[float]) -> str:
    if not rivals_deg:
        return ""
    return (
        f"two bright regions near one another, first at {rivals_deg[0]:g} deg: the one with the larger sum of grey "
        "values is taken; name the rectangle around the tip"
    )


def brightest_blob(
    image: UInt8[np.ndarray, "rows columns"], *, pixel_m: tuple[float, float], inside: Rectangle | None = None
) -> tuple[Rectangle, float]:
    """Return the brightest region of an image in a rectangle grown by `GROWN_M`, and its grey value under a blur.

    ``pixel_m``: height and width of a pixel. ``inside``: None: everywhere.
    """
    require_image(image)
    cv2 = opencv(PURPOSE)
    blurred = cv2.GaussianBlur(
        image.astype(np.float32), (0, 0), sigmaX=_BLUR_M / pixel_m[1], sigmaY=_BLUR_M / pixel_m[0]
    )
    part = Rectangle(row=0, column=0, rows=image.shape[0], columns=image.shape[1])
    if inside is not None:
        part = inside.within(image.shape)
    window = blurred[part.slices]
    top = float(window.max())
    # Half way up from the brightest twentieth, which is tissue: pad and air may fill most of the image.
    above = (window >= (top + float(np.quantile(window, _TISSUE_SHARE))) / 2).astype(np.uint8)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(above, connectivity=8)
    left, upper, width, height, _ = (int(each) for each in boxes[labels.ravel()[int(np.argmax(window))]])
    blob = Rectangle(row=part.row + upper, column=part.column + left, rows=max(3, height), columns=max(3, width))
    return blob.grown(*_pixels(GROWN_M, pixel_m), shape=image.shape), top


def find_tip(image: UInt8[np.ndarray, "rows columns"], rectangle: Rectangle, *, pixel_m: tuple[float, float]) -> Tip:
    """Return the tip in a rectangle of one image; equal arguments give equal results.

    ``rectangle``: where it is looked for; the part inside of the image counts. ``pixel_m``: height and width of a
    pixel.
    """
    require_image(image)
    rectangle = rectangle.within(image.shape)
    cv2 = opencv(PURPOSE)
    # Only the surroundings, so that tissue, and not all else in the image, is the background.
    around = rectangle.grown(*_pixels(_AROUND_M, pixel_m), shape=image.shape)
    # GrabCut knows neighbours of one pixel only; speckle, which is coarser, would fall apart without the blur.
    smooth = cv2.GaussianBlur(
        image[around.slices], (0, 0), sigmaX=_SMOOTH_M / pixel_m[1], sigmaY=_SMOOTH_M / pixel_m[0]
    )
    mask = _grab_cut(smooth, rectangle.relative_to(around))
    _, labels, boxes, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    # Of several regions the one whose grey values add up to most; label 0 is the background.
    sums = np.bincount(labels.ravel(), weights=image[around.slices].ravel(), minlength=len(boxes))[1:]
    if sums.size == 0 or sums.max() <= 0:
        return Tip(
            visible=False,
            reason="nothing in the rectangle stands out",
            intensity=0.0,
            level=float(image[around.slices].mean() + _SIGMAS * image[around.slices].std()),
            row=rectangle.row + (rectangle.rows - 1) / 2,
            column=rectangle.column + (rectangle.columns - 1) / 2,
            area_px=0,
            rectangle=rectangle,
        )
    best = int(np.argmax(sums)) + 1
    rivals = int(np.sum((sums >= RIVAL_SHARE * sums.max()) & (boxes[1:, cv2.CC_STAT_AREA] >= MIN_PX))) - 1
    column = float(centroids[best][0]) + around.column
    row = float(centroids[best][1]) + around.row
    upper = int(boxes[best][cv2.CC_STAT_TOP]) + around.row
    height = int(boxes[best][cv2.CC_STAT_HEIGHT])
    left = int(boxes[best][cv2.CC_STAT_LEFT]) + around.column
    width = int(boxes[best][cv2.CC_STAT_WIDTH])
    inside = min(upper, left) > 0 and upper + height < image.shape[0] and left + width < image.shape[1]
    area = int(boxes[best][cv2.CC_STAT_AREA])
    mean, deviation = _tissue(image, rectangle, around, upper, height)
    intensity = float(image[round(row), round(column)])
    level = mean + _SIGMAS * deviation
    small = area < MIN_PX
    dark = not intensity > level
    reason = (
        f"a region of {area} pixels, below {MIN_PX}"
        if small
        else f"a centroid of {intensity:g}, tissue beside it reaches {level:.0f}"
    )
    return Tip(
        visible=not (small or dark),
        reason=reason,
        intensity=intensity,
        level=level,
        row=row,
        column=column,
        area_px=area,
        rivals=max(0, rivals),
        rectangle=rectangle,
        cut_off=not inside,
    )


def _grab_cut(part: UInt8[np.ndarray, "rows columns"], rectangle: Rectangle) -> UInt8[np.ndarray, "rows columns"]:
    """1 where GrabCut sees the object, else 0."""
    cv2 = opencv(PURPOSE)
    mask = np.zeros(part.shape, np.uint8)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    box = (rectangle.column, rectangle.row, rectangle.columns, rectangle.rows)
    inside = part[rectangle.slices]
    outside = np.ones(part.shape, bool)
    outside[rectangle.slices] = False
    # Its mixtures need five different samples on either side; an even area has no object.
    if len(np.unique(inside)) < 5 or np.count_nonzero(outside) < 5:
        return mask
    # Its clusters begin at random, with a generator of OpenCV's own.
    cv2.setRNGSeed(_SEED)
    cv2.grabCut(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR), mask, box, *models, _ROUNDS, cv2.GC_INIT_WITH_RECT)
    return np.asarray(np.isin(mask, (cv2.GC_FGD, cv2.GC_PR_FGD)).astype(np.uint8))


def _tissue(
    image: UInt8[np.ndarray, "rows columns"], rectangle: Rectangle, around: Rectangle, row: int, rows: int
) -> tuple[float, float]:
    """Return the mean and standard deviation of the grey values beside the rectangle, at the same depth."""
    # At the same depth, because pad and air above and below the tissue are dark and would widen the deviation.
    band = image[row : row + rows]
    beside: Float64[np.ndarray, " pixels"] = np.concatenate(
        [
            band[:, around.column : rectangle.column].ravel(),
            band[:, rectangle.column + rectangle.columns : around.column + around.columns].ravel(),
        ]
    ).astype(np.float64)
    if beside.size < MIN_PX:
        raise ConfigError(
            f"rectangle of {rectangle.rows} × {rectangle.columns} pixels: there is no tissue beside it to compare "
            "with; name a smaller one"
        )
    return float(beside.mean()), float(beside.std())


def _pixels(distance_m: float, pixel_m: tuple[float, float]) -> tuple[int, int]:
    return round(distance_m / pixel_m[0]), round(distance_m / pixel_m[1])
