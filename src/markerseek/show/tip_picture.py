"""Figure of the tip of an instrument: its images in a strip, and its intensity over the angle (paper, Fig. 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import UInt8
from markerseek.show.style import ACCENT, GRID, QUIET, SIGNAL, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from markerseek.vision import TipFrame

MAX_SHOWN = 8
"""Most images in the strip; if there are more, every second, third … is shown."""


def tip_figure(
    frames: Sequence[TipFrame],
    images: Sequence[UInt8[np.ndarray, "rows columns"]],
    *,
    title: str,
    low_deg: float | None = None,
    high_deg: float | None = None,
) -> Figure:
    """Return the figure of a series.

    ``frames``, ``images``: in the order of the angles. ``low_deg``, ``high_deg``: ends of the sensitive range.
    """
    shown = list(zip(frames, images, strict=True))[:: max(1, math.ceil(len(images) / MAX_SHOWN))]
    figure = new_figure(width_in=max(7.0, 1.7 * len(shown)), height_in=5.6, heading=title, fontsize=10)
    grid = figure.add_gridspec(2, len(shown), height_ratios=(1.0, 1.5))
    for place, (frame, image) in enumerate(shown):
        axes = figure.add_subplot(grid[0, place])
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        tip = frame.tip
        if tip is not None and tip.visible:
            axes.plot(tip.column, tip.row, "o", markersize=16, markerfacecolor="none", markeredgecolor=ACCENT)
        axes.set_title(f"{frame.angle_deg:g}°", fontsize=9)
        axes.set_axis_off()
    axes = figure.add_subplot(grid[1, :])
    # A region of no pixels has no grey value.
    tips = {frame.angle_deg: frame.tip for frame in frames if frame.tip is not None and frame.tip.area_px}
    seen = [tip.intensity for tip in tips.values()]
    level = [tip.level for tip in tips.values()]
    axes.plot(list(tips), seen, color=SIGNAL, marker="o", label="grey value of the tip")
    axes.plot(list(tips), level, color=QUIET, linestyle="--", label="level that it must exceed")
    if low_deg is not None and high_deg is not None:
        axes.axvspan(low_deg, high_deg, color=ACCENT, alpha=0.12, label=f"seen, {low_deg:g}° to {high_deg:g}°")
    axes.set_xlabel("angle of the probe [deg]")
    axes.set_ylabel("grey value")
    # Around what was measured: a series may go on far beyond the angle at which the tip had disappeared.
    axes.margins(x=0.04, y=0.08)
    axes.grid(visible=True, color=GRID, linewidth=0.6)
    shared_legend(figure)
    return figure
