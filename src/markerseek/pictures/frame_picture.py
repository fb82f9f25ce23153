"""The picture of one frame: its photoacoustic image with the arrivals numbered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float32, Float64

from markerseek.pictures.canvas import ACCENT, new_figure
from markerseek.pictures.image_panel import draw_image

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
    figure = new_figure(width_in=5.6, height_in=8.0)
    axes = figure.add_subplot()
    draw_image(axes, envelope, lateral_m=lateral_m, depth_m=depth_m)
    for number, (lateral, depth) in enumerate(marks_m, start=1):
        axes.plot(1e3 * lateral, 1e3 * depth, marker="o", markersize=14, markerfacecolor="none", color=ACCENT)
        axes.annotate(
            str(number), (1e3 * lateral, 1e3 * depth), xytext=(9, 6), textcoords="offset points", color=ACCENT
        )
    axes.set_title(title, fontsize=9)
    return figure
