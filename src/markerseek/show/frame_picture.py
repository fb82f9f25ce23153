"""Figures of photoacoustic frames, and of banks of them.

A photoacoustic image is oriented like B-mode: lateral across, depth downwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markerseek.core import PaImage
from markerseek.show.curve import ANGLE_TEXT
from markerseek.show.grey import RANGE_DB, decibels_below_peak
from markerseek.show.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_image(axes: Axes, image: PaImage) -> None:
    """Draw a photoacoustic image relative to its largest value, in millimetres of the array."""
    decibels = decibels_below_peak(image.envelope, peak=float(image.envelope.max()))
    extent = image.geometry.edges_mm(*image.envelope.shape)
    shown = axes.imshow(
        decibels, extent=extent, cmap="gray", vmin=-RANGE_DB, vmax=0, aspect="equal", interpolation="bilinear"
    )
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth from the array's face [mm]")
    axes.figure.colorbar(shown, ax=axes, shrink=0.6).set_label("dB re peak")


_IMAGE_IN = (3.7, 5.2)
_BESIDE_IN = (1.9, 1.3)
"""Most width and height of an image in inches, and what axes, bar and heading take besides."""

_MIN_WIDTH_IN = 2.8


def frame_figure(image: PaImage, *, marks_m: Sequence[tuple[float, float]], title: str) -> Figure:
    """Return the figure of one frame: its photoacoustic image with numbered arrivals.

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


def peak_figure(
    angles_deg: Sequence[float],
    intensities: Sequence[float],
    *,
    title: str,
    max_deg: float,
    com_deg: float,
    cen_deg: float | None,
    fwhm_deg: float | None,
    reference_deg: float | None,
    dark_level: float | None,
    image: PaImage | None,
) -> Figure:
    """Return the figure of the peak of one bank.

    ``max_deg``, ``com_deg``, ``cen_deg``, ``fwhm_deg``: statistics of the peak; None if the curve has none.
    ``reference_deg``: known angle of the marker, or None. ``dark_level``: largest intensity of a frame without laser.
    ``image``: None if there are no frames.
    """
    figure = new_figure(width_in=10.0 if image is not None else 6.6, height_in=5.2, heading=title, fontsize=11.0)
    grid = figure.add_gridspec(1, 2 if image is not None else 1, width_ratios=(3, 2) if image is not None else None)
    axes = figure.add_subplot(grid[0, 0])
    axes.plot(angles_deg, intensities, color=SIGNAL, marker="o", markersize=2.5, linewidth=1, label="acquisitions")
    top = max(intensities)
    if cen_deg is not None and fwhm_deg is not None:
        # Drawn at half of the maximum, where the width is measured.
        ends = (cen_deg - fwhm_deg / 2, cen_deg + fwhm_deg / 2)
        axes.plot(ends, (top / 2, top / 2), color=QUIET, marker="|", markersize=9, label=f"fwhm {fwhm_deg:.2f}°")
    axes.axvline(max_deg, color=ACCENT, linewidth=1, label=f"max {max_deg:.2f}°")
    if cen_deg is not None:
        axes.axvline(cen_deg, color=ACCENT, linestyle="--", linewidth=1, label=f"cen {cen_deg:.2f}°")
    axes.axvline(com_deg, color=QUIET, linestyle="-.", linewidth=1, label=f"com {com_deg:.2f}°")
    if reference_deg is not None:
        axes.axvline(reference_deg, color=TRUTH, linestyle=":", label=f"reference {reference_deg:.2f}°")
    if dark_level is not None:
        axes.axhline(dark_level, color=QUIET, linestyle=":", label="largest without laser")
    # At least 1e-12, because Matplotlib warns of a range from 0 to 0.
    axes.set_ylim(bottom=0, top=1.08 * max(top, dark_level or 0.0, 1e-12))
    axes.set_xlabel(ANGLE_TEXT)
    axes.set_ylabel("intensity (envelope peak) " + ("[as recorded]" if image is None else "[counts]"))
    axes.set_xlim(angles_deg[0], angles_deg[-1])
    if image is not None:
        panel = figure.add_subplot(grid[0, 1])
        draw_image(panel, image)
        panel.set_title(f"photoacoustic image at {max_deg:.2f}°", fontsize=9)
    shared_legend(figure, columns=4)
    return figure
