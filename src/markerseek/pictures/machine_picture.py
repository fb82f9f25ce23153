"""Figures of the files of an ultrasound machine: B-mode images and radio-frequency lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Int16, UInt8
from markerseek.pictures.style import new_figure, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def b_mode_figure(pixels: UInt8[np.ndarray, "rows columns"], *, title: str) -> Figure:
    """Figure of a B-mode image, in its own grey values and pixels."""
    figure = new_figure(width_in=7.0, height_in=5.6)
    axes = figure.add_subplot()
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255, aspect="equal", interpolation="nearest")
    axes.set_xlabel("column [pixel]")
    axes.set_ylabel("row [pixel]")
    put_title(axes, title, width_in=6.0)
    return figure


def rf_figure(lines: Int16[np.ndarray, "lines samples"], *, sampling_hz: float | None, title: str) -> Figure:
    """Figure of radio-frequency lines: line across, time downwards, over a symmetric scale of counts.

    Parameters
    ----------
    lines
        Samples of each line.
    sampling_hz
        Sampling frequency in Hz; None draws over the number of the sample.
    title
        What it is.
    """
    figure = new_figure(width_in=5.6, height_in=7.0)
    axes = figure.add_subplot()
    # The largest samples come from the skin: up to one in a hundred may be clipped.
    most = max(float(np.quantile(np.abs(lines.astype(np.float32)), 0.99)), 1.0)
    count = lines.shape[1] if sampling_hz is None else 1e6 * lines.shape[1] / sampling_hz
    # From 0.5, so that each line is centred on its number.
    extent = (0.5, lines.shape[0] + 0.5, count, 0.0)
    shown = axes.imshow(
        lines.T, cmap="RdBu", vmin=-most, vmax=most, extent=extent, aspect="auto", interpolation="nearest"
    )
    axes.set_xlabel("line")
    axes.set_ylabel("sample" if sampling_hz is None else "time [µs]")
    put_title(axes, title, width_in=4.4)
    figure.colorbar(shown, ax=axes, shrink=0.6).set_label("counts")
    return figure
