"""Figure of a registration: the points of both systems in the TRUS frame, from above and from the end of the probe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float64, UInt8
from markerseek.pictures.style import ACCENT, GRID, QUIET, SIGNAL, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EXAGGERATION = 10
"""Factor by which the residuals are drawn longer than they are."""

_VIEWS = (("from above", 0, 1), ("along the axis of the probe", 0, 2))


def registration_figure(
    trus_m: Float64[np.ndarray, "points 3"],
    transformed_m: Float64[np.ndarray, "points 3"],
    *,
    names: Sequence[str],
    target_m: Sequence[float],
    title: str,
) -> Figure:
    """Figure of one registration.

    ``trus_m``, ``transformed_m``: the points in the TRUS frame, as the searches found them and as the transformed
    camera points. ``target_m``: where the target registration error is given, in the TRUS frame. ``title``: what was
    registered, and how well.
    """
    figure = new_figure(width_in=10.5, height_in=5.2, heading=title)
    for axes, (view, across, up) in zip(figure.subplots(1, 2), _VIEWS, strict=True):
        x, y = 1e3 * trus_m[:, across], 1e3 * trus_m[:, up]
        far = 1e3 * (trus_m + EXAGGERATION * (transformed_m - trus_m))
        for number in range(len(trus_m)):
            label = f"residual, {EXAGGERATION} times as long" if number == 0 else None
            axes.plot([x[number], far[number, across]], [y[number], far[number, up]], color=ACCENT, label=label)
            axes.annotate(names[number], (x[number], y[number]), xytext=(6, 6), textcoords="offset points", fontsize=8)
        axes.scatter(x, y, color=SIGNAL, s=36, zorder=3, label="marker found by the probe")
        axes.scatter(
            [1e3 * target_m[across]], [1e3 * target_m[up]], color=QUIET, marker="x", s=60, label="target of the TRE"
        )
        axes.set_title(view, fontsize=10)
        axes.set_xlabel(f"{'xyz'[across]} [mm]")
        axes.set_ylabel(f"{'xyz'[up]} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        axes.grid(visible=True, color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
    shared_legend(figure)
    return figure


SIGMAS_OF_95 = math.sqrt(-2 * math.log(0.05))
"""Half an axis of the ellipse that holds 95 % of a normal distribution in two dimensions, over its standard deviation:
the root of the quantile of chi squared with 2 degrees of freedom."""

LEAST_SHOWN = 0.05
"""Least axis of an ellipse over the height of an image: a smaller one is drawn ten times as large, dashed."""


def target_figure(
    views: Sequence[
        tuple[str, UInt8[np.ndarray, "rows columns"], Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"]]
    ],
    *,
    title: str,
) -> Figure:
    """Figure of one target.

    ``views``: name of each camera, its image, the target's pixel (column, row), and the covariance of that in px².
    ``title``: what was registered, and how well.
    """
    from matplotlib.patches import Ellipse

    figure = new_figure(width_in=5.6 * len(views), height_in=5.0, heading=title)
    for axes, (name, image, pixel, covariance_px2) in zip(figure.subplots(1, len(views)), views, strict=True):
        rows, columns = image.shape
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        variance, direction = np.linalg.eigh(covariance_px2)
        axis_px = SIGMAS_OF_95 * np.sqrt(np.maximum(variance, 0.0))
        turned_deg = float(np.degrees(np.arctan2(direction[1, 1], direction[0, 1])))
        times = 10 if 2 * axis_px[1] < LEAST_SHOWN * rows else 1
        axes.add_patch(
            Ellipse(
                (pixel[0], pixel[1]),
                2 * times * axis_px[1],
                2 * times * axis_px[0],
                angle=turned_deg,
                fill=False,
                edgecolor=ACCENT,
                linewidth=1.5,
                linestyle="-" if times == 1 else "--",
            )
        )
        axes.plot(*pixel, marker="+", markersize=12, color=ACCENT, linestyle="none")
        seen = -0.5 <= pixel[0] <= columns - 0.5 and -0.5 <= pixel[1] <= rows - 0.5
        drawn = "" if times == 1 else f", drawn {times} times as large"
        size = f"in 95 % within {axis_px[1]:.1f} x {axis_px[0]:.1f} px{drawn}" if seen else "not in the image"
        axes.set_title(f"{name}: {size}", fontsize=10)
        axes.set_xlim(-0.5, columns - 0.5)
        axes.set_ylim(rows - 0.5, -0.5)
        axes.set_axis_off()
    return figure
