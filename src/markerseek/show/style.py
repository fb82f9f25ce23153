"""Style of all figures: colours, figures without a display, headings, grids of panels.

Everything else is drawn with Matplotlib directly. Matplotlib is an extra; it is imported when the first figure is made.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, Literal

from markerseek.core import needs_package

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIGNAL = "#1f5fa8"
ACCENT = "#c8501e"
TRUTH = "#2a7f3f"
QUIET = "#8a8f98"
"""Colours of measurements, of conclusions, of the truth, and of the rest; the colour-blind can tell them apart."""

GRID = "#e3e6ea"
"""Colour of grid lines."""

ERROR_BARS: dict[str, Any] = {"markersize": 3.5, "linewidth": 1.2, "elinewidth": 0.8, "capsize": 1.5}
"""Sizes of a line with marks and error bars, for `matplotlib.axes.Axes.errorbar`."""


def new_figure(*, width_in: float, height_in: float, heading: str | None = None, fontsize: float = 12.0) -> Figure:
    """Return an empty figure that needs no display, with a heading over the whole of it.

    ``width_in``, ``height_in``: size in inches. ``heading``, ``fontsize``: the heading, which is wrapped to the width,
    and its size in points; None: no heading.
    """
    with needs_package("matplotlib", extra="plot", purpose="a picture"):
        from matplotlib.figure import Figure
    # Not pyplot, which selects a display and keeps every figure in memory.
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    if heading is not None:
        # Letters of the default font are 0.55 of its size wide on average; paths have wider ones, hence 0.6.
        lines = textwrap.fill(heading, int(width_in * 72 / (0.6 * fontsize)), break_on_hyphens=False)
        # A "$" in the name of a file is no mathematics.
        figure.suptitle(lines, fontsize=fontsize, x=0.01, ha="left", parse_math=False)
    return figure


def panel_grid(
    titles: list[str],
    *,
    heading: str,
    x_label: str,
    y_label: str,
    columns: int,
    panel_in: tuple[float, float],
    y_scale: Literal["linear", "log"] = "linear",
) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels that share both axes, and the axes of the panels, row by row.

    ``x_label``, ``y_label``: labels of the shared axes. ``columns``: most panels in a row. ``panel_in``: width and
    height of one panel in inches.
    """
    columns = min(columns, len(titles))
    rows = -(-len(titles) // columns)
    figure = new_figure(width_in=panel_in[0] * columns, height_in=panel_in[1] * rows + 0.8, heading=heading)
    grid = list(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).flat)
    for empty in grid[len(titles) :]:
        empty.set_axis_off()
    for number, (axes, title) in enumerate(zip(grid, titles, strict=False)):
        axes.set_yscale(y_scale)
        axes.set_title(title, fontsize=10)
        axes.grid(visible=True, color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
        if number >= len(titles) - columns:
            axes.set_xlabel(x_label)
            # A panel above an empty place is not in the last row, where Matplotlib puts the shared labels.
            axes.tick_params(labelbottom=True)
        if number % columns == 0:
            axes.set_ylabel(y_label)
    return figure, grid[: len(titles)]


def shared_legend(figure: Figure, *, columns: int = 6, title: str | None = None) -> None:
    """Put one legend below all panels, with each label once, in at most this number of columns."""
    entries = [entry for axes in figure.axes for entry in zip(*axes.get_legend_handles_labels(), strict=True)]
    # Reversed, so that the first handle of a label is the one that stays.
    by_label = {label: handle for handle, label in reversed(entries)}
    labels = list(dict.fromkeys(label for _, label in entries))
    figure.legend(
        [by_label[label] for label in labels],
        labels,
        loc="outside lower center",
        ncols=min(len(labels), columns),
        fontsize=8,
        title=title,
        title_fontsize=8,
    )
