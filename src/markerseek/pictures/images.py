"""Figures of photoacoustic frames.

A photoacoustic image is oriented like B-mode: lateral across, depth downwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import PaImage
from markerseek.pictures.style import ACCENT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DYNAMIC_RANGE_DB = 40.0
"""From the brightest pixel to black, in dB."""


def draw_image(axes: Axes, image: PaImage) -> None:
    """Draw a photoacoustic image relative to its largest value, in millimetres of the array."""
    # An image of zeros is black, instead of dividing by 0.
    peak = max(float(image.envelope.max()), float(np.finfo(np.float32).tiny))
    decibels = 20 * np.log10(np.maximum(image.envelope / peak, 10 ** (-DYNAMIC_RANGE_DB / 20)))
    extent = image.geometry.edges_mm(*image.envelope.shape)
    shown = axes.imshow(
        decibels, extent=extent, cmap="gray", vmin=-DYNAMIC_RANGE_DB, vmax=0, aspect="equal", interpolation="bilinear"
    )
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    axes.figure.colorbar(shown, ax=axes, shrink=0.6).set_label("dB re peak")


_IMAGE_IN, _BESIDE_IN = (3.7, 5.2), (1.9, 1.3)
"""Most width and height of an image in inches, and what axes, bar and heading take besides."""

_MIN_WIDTH_IN = 2.8


def frame_figure(image: PaImage, *, marks_m: Sequence[tuple[float, float]], title: str) -> Figure:
    """Figure of one frame: its photoacoustic image with numbered arrivals.

    ``marks_m``: lateral position and depth of each arrival, strongest first.
    """
    left, right, bottom, top = image.geometry.edges_mm(*image.envelope.shape)
    ratio = abs(right - left) / abs(bottom - top)
    # In true proportions: no wider and no higher than the image needs.
    width_in = min(_IMAGE_IN[0], _IMAGE_IN[1] * ratio)
    figure = new_figure(
        width_in=max(width_in + _BESIDE_IN[0], _MIN_WIDTH_IN),
        height_in=width_in / ratio + _BESIDE_IN[1],
        heading=title,
        fontsize=9.0,
    )
    axes = figure.add_subplot()
    draw_image(axes, image)
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
    return figure
