"""The sensitive range as in section 2.5 D of the paper: GrabCut, centroid and its grey value, image by image.

From the reference, where the tip is brightest, the probe is turned in even steps until the tip has disappeared; what
lies between the two is half of the range.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from markerseek.core import UInt8
from markerseek.vision.rectangle import Rectangle
from markerseek.vision.sensitive_range import GONE_FRAMES, SensitiveRange, TipFrame, angular_order, no_tip
from markerseek.vision.tooltip import Tip, brightest_blob, find_tip


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
        edge = "the region reaches the edge of the image; name the rectangle around the tip, --roi"
        tips[start] = replace(tips[start], visible=False, reason=edge)
    if not tips[start].visible:
        nothing = no_tip(angles, f"no tip in the brightest image, at {angles[start]:g} deg: {tips[start].reason}")
        frames = tuple(TipFrame(angle_deg=angle, tip=tips.get(k)) for k, angle in enumerate(angles))
        return replace(nothing, frames=frames)
    for side in (range(start + 1, len(order)), range(start - 1, -1, -1)):
        tips |= _followed(images, order, side, tips[start], first, pixel_m)
    visible = [k for k, tip in tips.items() if tip.visible]
    reference = max(visible, key=lambda k: (tips[k].intensity, -abs(k - start)))
    low, high = min(visible), max(visible)
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
    """The tip in the images of one side, until it has disappeared."""
    found: dict[int, Tip] = {}
    gone = 0
    for k in side:
        # Carried along with the tip: its depth changes as the probe turns.
        found[k] = find_tip(images[order[k]], rectangle.centred(tip.row, tip.column), pixel_m=pixel_m)
        if found[k].visible:
            tip, gone = found[k], 0
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
        "values is taken; name the rectangle around the tip alone, --roi"
    )
