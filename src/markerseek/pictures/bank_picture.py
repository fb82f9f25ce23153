"""Figure of a bank: intensity over angle with the statistics of its peak, and the image at the maximum."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from markerseek.core import PaImage
from markerseek.pictures.images import draw_image
from markerseek.pictures.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def bank_figure(
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
    """Figure of one bank.

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
    axes.set_xlabel("probe angle [deg]")
    axes.set_ylabel("intensity (envelope peak) " + ("[as recorded]" if image is None else "[counts]"))
    axes.set_xlim(angles_deg[0], angles_deg[-1])
    if image is not None:
        panel = figure.add_subplot(grid[0, 1])
        draw_image(panel, image)
        panel.set_title(f"photoacoustic image at {max_deg:.2f}°", fontsize=9)
    shared_legend(figure, columns=4)
    return figure
