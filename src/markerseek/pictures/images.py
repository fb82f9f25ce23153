"""Figures of images: photoacoustic frames, alone or over B-mode.

A photoacoustic image is oriented like B-mode: lateral across, depth downwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import BModeImage, Float32, PaImage
from markerseek.pictures.style import ACCENT, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colorbar import Colorbar
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

DYNAMIC_RANGE_DB = 40.0
"""From the brightest pixel to black, in dB."""

OVERLAY_RANGE_DB = 20.0
"""From the brightest pixel to a transparent one over B-mode, in dB: more would hide the B-mode image."""


def draw_image(axes: Axes, image: PaImage) -> None:
    """Draw a photoacoustic image relative to its largest value."""
    decibels = _below_peak_db(image, least=10 ** (-DYNAMIC_RANGE_DB / 20))
    extent = image.geometry.edges_mm(*image.envelope.shape)
    shown = axes.imshow(
        decibels, extent=extent, cmap="gray", vmin=-DYNAMIC_RANGE_DB, vmax=0, aspect="equal", interpolation="bilinear"
    )
    _finish(axes, shown, label="dB re peak")


def draw_overlay(axes: Axes, b_mode: BModeImage, image: PaImage) -> None:
    """Draw a photoacoustic image over a B-mode image, in millimetres of the array; each is placed by its geometry.

    ``b_mode``: drawn in grey; its edges are those of the picture. ``image``: drawn in hot colours above
    -`OVERLAY_RANGE_DB` of its peak, and transparent below.
    """
    extent = b_mode.geometry.edges_mm(*b_mode.pixels.shape)
    axes.imshow(b_mode.pixels, cmap="gray", vmin=0, vmax=255, extent=extent, aspect="equal", interpolation="nearest")
    share = _below_peak_db(image, least=1e-6) / OVERLAY_RANGE_DB + 1
    shown = axes.imshow(
        np.clip(share, 0, 1),
        cmap="hot",
        vmin=0,
        vmax=1,
        alpha=np.clip(share, 0, 1),
        extent=image.geometry.edges_mm(*image.envelope.shape),
        aspect="equal",
        interpolation="nearest",
    )
    # What lies outside of the B-mode image has nothing to be compared with.
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])
    bar = _finish(axes, shown, label="photoacoustic, dB re peak")
    bar.set_ticks([0, 1], labels=[f"−{OVERLAY_RANGE_DB:g}", "0"])


def _below_peak_db(image: PaImage, *, least: float) -> Float32[np.ndarray, "depths laterals"]:
    """The image over its peak in dB, not below the share ``least`` of it."""
    # An image of zeros is at that share everywhere, instead of dividing by 0.
    peak = max(float(image.envelope.max()), float(np.finfo(np.float32).tiny))
    decibels: Float32[np.ndarray, "depths laterals"] = 20 * np.log10(np.maximum(image.envelope / peak, least))
    return decibels


def _finish(axes: Axes, shown: AxesImage, *, label: str) -> Colorbar:
    """Name the axes in millimetres of the array, and put a bar of the colours beside them."""
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.6)
    bar.set_label(label)
    return bar


def frame_figure(image: PaImage, *, marks_m: Sequence[tuple[float, float]], title: str) -> Figure:
    """Figure of one frame: its photoacoustic image with numbered arrivals.

    ``marks_m``: lateral position and depth of each arrival, strongest first.
    """
    figure = _figure_of(image.geometry.edges_mm(*image.envelope.shape), title=title)
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


_IMAGE_IN, _BESIDE_IN = (3.7, 5.2), (1.9, 1.3)
"""Most width and height of an image in inches, and what axes, bar and heading take besides."""

_MIN_WIDTH_IN = 2.8


def _figure_of(edges_mm: tuple[float, float, float, float], *, title: str) -> Figure:
    """Empty figure for one image in true proportions: no wider and no higher than the image needs."""
    left, right, bottom, top = edges_mm
    ratio = abs(right - left) / abs(bottom - top)
    width_in = min(_IMAGE_IN[0], _IMAGE_IN[1] * ratio)
    return new_figure(
        width_in=max(width_in + _BESIDE_IN[0], _MIN_WIDTH_IN),
        height_in=width_in / ratio + _BESIDE_IN[1],
        heading=title,
        fontsize=9.0,
    )
