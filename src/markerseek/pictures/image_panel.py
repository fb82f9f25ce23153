"""Draws a photoacoustic image, alone or over B-mode, oriented like B-mode: lateral across, depth downwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import BModeImage, Float32, Float64, PaImage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DYNAMIC_RANGE_DB = 40.0
"""From the brightest pixel to black, in dB."""

OVERLAY_RANGE_DB = 20.0
"""From the brightest pixel to a transparent one over B-mode, in dB: more would hide the B-mode image."""


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


def draw_overlay(axes: Axes, b_mode: BModeImage, image: PaImage) -> None:
    """Draw a photoacoustic image over a B-mode image, in millimetres of the array; each is placed by its geometry.

    Parameters
    ----------
    axes
        Where to draw.
    b_mode
        Drawn in grey; its edges are those of the picture.
    image
        Drawn in hot colours above -`OVERLAY_RANGE_DB` of its peak, and transparent below.
    """
    extent = b_mode.geometry.edges_mm(*b_mode.pixels.shape)
    axes.imshow(b_mode.pixels, cmap="gray", vmin=0, vmax=255, extent=extent, aspect="equal", interpolation="nearest")
    # An image of zeros is wholly transparent instead of dividing by 0.
    peak = max(float(image.envelope.max()), float(np.finfo(np.float32).tiny))
    share = 20 * np.log10(np.maximum(image.envelope / peak, 1e-6)) / OVERLAY_RANGE_DB + 1
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
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.6)
    bar.set_ticks([0, 1], labels=[f"-{OVERLAY_RANGE_DB:g} dB", "0 dB"])
    bar.set_label("photoacoustic, below its peak")
