"""Figure of a photoacoustic image over the B-mode image of the same angle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markerseek.core import BModeImage, PaImage
from markerseek.pictures.image_panel import draw_overlay
from markerseek.pictures.style import ACCENT, new_figure, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def overlay_figure(b_mode: BModeImage, image: PaImage, *, marks_m: Sequence[tuple[float, float]], title: str) -> Figure:
    """Figure with both images in millimetres of the array.

    Parameters
    ----------
    b_mode, image
        The B-mode image, and the photoacoustic image over it.
    marks_m
        Lateral position and depth of each source in metres.
    title
        What it is.
    """
    figure = new_figure(width_in=6.2, height_in=6.4)
    axes = figure.add_subplot()
    draw_overlay(axes, b_mode, image)
    for lateral_m, depth_m in marks_m:
        axes.plot(1e3 * lateral_m, 1e3 * depth_m, marker="o", markersize=14, markerfacecolor="none", color=ACCENT)
    put_title(axes, title, width_in=5.0)
    return figure
