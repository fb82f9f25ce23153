"""Figure of a photoacoustic image over the B-mode image of the same angle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import PaImage, ScanGeometry, UInt8
from markerseek.pictures.style import ACCENT, new_figure, put_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DYNAMIC_RANGE_DB = 20.0
"""From the brightest pixel of the photoacoustic image to a transparent one, in dB: less hides the B-mode image."""


def overlay_figure(
    pixels: UInt8[np.ndarray, "rows columns"],
    geometry: ScanGeometry,
    image: PaImage,
    *,
    marks_m: Sequence[tuple[float, float]],
    title: str,
) -> Figure:
    """Figure with both images in millimetres of the array; each is placed by its `ScanGeometry`.

    Parameters
    ----------
    pixels, geometry
        Grey values of the B-mode image, and where they are.
    image
        The photoacoustic image.
    marks_m
        Lateral position and depth of each source in metres.
    title
        What it is.
    """
    figure = new_figure(width_in=6.2, height_in=6.4)
    axes = figure.add_subplot()
    extent = geometry.edges_mm(*pixels.shape)
    axes.imshow(pixels, cmap="gray", vmin=0, vmax=255, extent=extent, aspect="equal", interpolation="nearest")
    # An image of zeros is wholly transparent instead of dividing by 0.
    peak = max(float(image.envelope.max()), float(np.finfo(np.float32).tiny))
    share = 20 * np.log10(np.maximum(image.envelope / peak, 1e-6)) / DYNAMIC_RANGE_DB + 1
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
    for lateral_m, depth_m in marks_m:
        axes.plot(1e3 * lateral_m, 1e3 * depth_m, marker="o", markersize=14, markerfacecolor="none", color=ACCENT)
    # What lies outside of the B-mode image has nothing to be compared with.
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    bar = figure.colorbar(shown, ax=axes, shrink=0.6)
    bar.set_ticks([0, 1], labels=[f"-{DYNAMIC_RANGE_DB:g} dB", "0 dB"])
    bar.set_label("photoacoustic, below its peak")
    put_title(axes, title, width_in=5.0)
    return figure
