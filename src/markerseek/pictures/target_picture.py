"""Figure of a target over the images of the endoscope's cameras, with its expected error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float64, UInt8
from markerseek.pictures.style import ACCENT, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGMAS_OF_95 = 2.448
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
