"""Draws a photoacoustic image in decibels, oriented like B-mode: lateral across, depth downwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float32, Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DYNAMIC_RANGE_DB = 40.0
"""From the brightest pixel to black, in dB."""


def draw_image(
    axes: Axes,
    envelope: Float32[np.ndarray, "depths laterals"],
    *,
    lateral_m: Float64[np.ndarray, " laterals"],
    depth_m: Float64[np.ndarray, " depths"],
) -> None:
    """Draw an envelope relative to its largest value.

    Parameters
    ----------
    axes
        Where to draw.
    envelope
        Envelope, shape (depths, laterals).
    lateral_m, depth_m
        Axes in metres.
    """
    # An image of zeros is drawn black instead of dividing by 0.
    peak = max(float(envelope.max()), float(np.finfo(np.float32).tiny))
    decibels = 20 * np.log10(np.maximum(envelope / peak, 10 ** (-DYNAMIC_RANGE_DB / 20)))
    # The first row at the top: the depth axis runs downwards.
    extent = (1e3 * lateral_m[0], 1e3 * lateral_m[-1], 1e3 * depth_m[-1], 1e3 * depth_m[0])
    shown = axes.imshow(
        decibels, extent=extent, cmap="gray", vmin=-DYNAMIC_RANGE_DB, vmax=0, aspect="equal", interpolation="bilinear"
    )
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.6)
    bar.set_label("dB below the peak")
