"""Figure of the tip of an instrument: its images in a strip, and its intensity over the angle (paper, Fig. 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import UInt8
from markerseek.pictures.style import ACCENT, GRID, QUIET, SIGNAL, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_SHOWN = 8
"""Most images of the strip; of more, every second, third … is shown."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TipImage:
    """One image of the strip."""

    angle_deg: float
    pixels: UInt8[np.ndarray, "rows columns"]
    centroid: tuple[float, float] | None
    """Row and column of the tip; None where it is not seen."""
    intensity: float | None
    level: float | None
    """``intensity`` and ``level``: grey value at the centroid, and the one that it must exceed; None where it is not
    known."""


def tip_figure(
    images: Sequence[TipImage], *, title: str, low_deg: float | None = None, high_deg: float | None = None
) -> Figure:
    """Figure of a series.

    ``images``: in the order of the angles. ``low_deg``, ``high_deg``: ends of the sensitive range.
    """
    shown = list(images[:: -(-len(images) // MAX_SHOWN)])
    figure = new_figure(width_in=max(7.0, 1.7 * len(shown)), height_in=5.6, heading=title, fontsize=10)
    grid = figure.add_gridspec(2, len(shown), height_ratios=(1.0, 1.5))
    for place, each in enumerate(shown):
        axes = figure.add_subplot(grid[0, place])
        axes.imshow(each.pixels, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        if each.centroid is not None:
            row, column = each.centroid
            axes.plot(
                column, row, marker="o", markersize=16, markerfacecolor="none", markeredgecolor=ACCENT, linestyle="none"
            )
        axes.set_title(f"{each.angle_deg:g}°", fontsize=9)
        axes.set_axis_off()
    axes = figure.add_subplot(grid[1, :])
    seen = {each.angle_deg: each.intensity for each in images if each.intensity is not None}
    level = {each.angle_deg: each.level for each in images if each.level is not None}
    axes.plot(list(seen), list(seen.values()), color=SIGNAL, marker="o", label="grey value of the tip")
    axes.plot(list(level), list(level.values()), color=QUIET, linestyle="--", label="tissue, mean + 3 sd")
    if low_deg is not None and high_deg is not None:
        axes.axvspan(low_deg, high_deg, color=ACCENT, alpha=0.12, label=f"seen, {low_deg:g}° to {high_deg:g}°")
    axes.set_xlabel("angle of the probe [deg]")
    axes.set_ylabel("grey value")
    # Around what was measured: a series may go on far beyond the angle at which the tip had disappeared.
    axes.margins(x=0.04, y=0.08)
    axes.grid(visible=True, color=GRID, linewidth=0.6)
    shared_legend(figure)
    return figure
