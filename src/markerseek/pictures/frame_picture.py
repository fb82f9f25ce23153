"""Figure of one frame: its photoacoustic image with numbered arrivals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float32, Float64
from markerseek.pictures.image_panel import draw_image
from markerseek.pictures.style import ACCENT, new_figure, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def frame_figure(
    envelope: Float32[np.ndarray, "depths laterals"],
    *,
    lateral_m: Float64[np.ndarray, " laterals"],
    depth_m: Float64[np.ndarray, " depths"],
    marks_m: Sequence[tuple[float, float]],
    title: str,
) -> Figure:
    """Figure of one frame.

    Parameters
    ----------
    envelope
        Envelope, shape (depths, laterals).
    lateral_m, depth_m
        Axes in metres.
    marks_m
        Lateral position and depth of each arrival in metres, strongest first.
    title
        What was imaged.
    """
    figure = new_figure(width_in=5.6, height_in=6.8)
    axes = figure.add_subplot()
    draw_image(axes, envelope, lateral_m=lateral_m, depth_m=depth_m)
    placed: list[tuple[float, float]] = []
    for number, (lateral, depth) in enumerate(marks_m, start=1):
        # Labels of neighbouring arrivals would overlap, so that each further one is shifted to the left.
        close = sum(abs(lateral - other[0]) < 3e-3 and abs(depth - other[1]) < 4e-3 for other in placed)
        placed.append((lateral, depth))
        axes.plot(1e3 * lateral, 1e3 * depth, marker="o", markersize=7, markerfacecolor="none", color=ACCENT)
        axes.annotate(
            str(number),
            (1e3 * lateral, 1e3 * depth),
            xytext=(-14 - 9 * close, -3),
            textcoords="offset points",
            color=ACCENT,
            fontsize=9,
            bbox={"facecolor": "black", "alpha": 0.6, "linewidth": 0, "pad": 1},
        )
    put_title(axes, title, width_in=4.4)
    return figure
