"""The sensitive range: by how many degrees the probe may be turned off an instrument's tip that it still shows.

The protocol of section 2.5 D of the paper: from the reference, where the tip is brightest, the probe is turned in even
steps until the tip has disappeared; what lies between the two is half of the range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import ConfigError, UInt8
from markerseek.vision.rectangle import Rectangle
from markerseek.vision.tooltip import Tip, brightest_blob, find_tip, require_image

GONE_FRAMES = 2
"""Frames in a row without the tip after which it has disappeared."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TipFrame:
    """The tip in one image of a series."""

    angle_deg: float
    tip: Tip | None
    """None beyond the angle at which the tip had disappeared, where it is not looked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensitiveRange:
    """Sensitive range of one tip."""

    frames: tuple[TipFrame, ...]
    """All images, in the order of their angles."""
    reference_deg: float | None
    """Angle of the brightest tip; None where no image shows one."""
    below_deg: float | None
    above_deg: float | None
    """``below_deg`` and ``above_deg``: half of the range on either side of it; None where no image lies there."""
    open_below: bool
    open_above: bool
    """``open_below`` and ``open_above``: whether the images of that side end before the tip has disappeared: its half
    is then at least this."""
    remark: str
    """What a person should know of the images; empty where there is nothing."""

    @property
    def half_deg(self) -> float | None:
        """Half of the range in degrees: of one side, or the mean of both; None where there is no tip."""
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
    """Follow the tip from the image in which it is brightest to either side, and measure how far it is seen.

    ``images``: grey values, all of one shape. ``pixel_m``: height and width of a pixel. ``rectangle``: where the tip is
    in the image of the reference; None: around the brightest region of all images.
    """
    order = _checked_order(angles_deg, images)
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
        return SensitiveRange(
            frames=tuple(TipFrame(angle_deg=angle, tip=tips.get(k)) for k, angle in enumerate(angles)),
            reference_deg=None,
            below_deg=None,
            above_deg=None,
            open_below=False,
            open_above=False,
            remark=f"no tip in the brightest image, at {angles[start]:g} deg: {tips[start].reason}",
        )
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


def _checked_order(angles_deg: Sequence[float], images: Sequence[np.ndarray]) -> list[int]:
    """Order of the images by angle."""
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
