"""Panels of lines side by side: one quantity over another, with intervals and reference marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from markerseek.core import ConfigError
from markerseek.pictures.canvas import QUIET, new_figure, put_heading

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """One line of a panel.

    Attributes
    ----------
    label
        Name in the legend; empty for none.
    x, y
        Places and values, equally many.
    half
        Half the width of an interval about each value; None for none.
    colour
        Any colour that Matplotlib knows.
    form
        Marks joined by a line, a mark alone, bars, or a horizontal line across the panel at the first value.
    mark
        Shape of the marks, as Matplotlib names it.
    """

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    half: tuple[float, ...] | None = None
    colour: str = QUIET
    form: Literal["joined", "mark", "bar", "level"] = "joined"
    mark: str = "o"

    def __post_init__(self) -> None:
        if len(self.x) != len(self.y) or (self.half is not None and len(self.half) != len(self.y)):
            raise ConfigError(f"line {self.label!r}: {len(self.x)} places for {len(self.y)} values and their intervals")


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One set of axes.

    Attributes
    ----------
    title
        What it shows.
    lines
        What is drawn in it.
    ticks
        Names at the places 1, 2, … of the axis across; none leaves numbers there.
    """

    title: str
    lines: tuple[Line, ...]
    ticks: tuple[str, ...] = ()


def panels_figure(
    panels: Sequence[Panel],
    *,
    title: str,
    across: str,
    up: str,
    columns: int = 3,
    scale: Literal["linear", "log"] = "linear",
    panel_in: tuple[float, float] = (3.7, 3.0),
    legend_columns: int = 5,
) -> Figure:
    """Figure of panels that share their axes, with one legend.

    Parameters
    ----------
    panels
        What is drawn, row by row.
    title
        Heading.
    across, up
        Labels of the axes.
    columns
        Panels in a row.
    scale
        Scale of the upward axis.
    panel_in
        Width and height of one panel in inches.
    legend_columns
        Most names in a row of the legend.
    """
    columns = min(columns, len(panels))
    rows = math.ceil(len(panels) / columns)
    figure = new_figure(width_in=panel_in[0] * columns, height_in=panel_in[1] * rows + 0.8)
    put_heading(figure, title)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    named: dict[str, object] = {}
    for number, axes in enumerate(grid.flat):
        if number >= len(panels):
            axes.set_axis_off()
            continue
        panel = panels[number]
        axes.set_yscale(scale)
        axes.set_title(panel.title, fontsize=10)
        for line in panel.lines:
            handle = _draw(axes, line)
            if line.label:
                named.setdefault(line.label, handle)
        if panel.ticks:
            axes.set_xticks(range(1, len(panel.ticks) + 1), panel.ticks, fontsize=8)
        axes.grid(visible=True, color="#e3e6ea", linewidth=0.6)
        axes.set_axisbelow(True)
        if number >= len(panels) - columns:
            axes.set_xlabel(across)
            axes.tick_params(labelbottom=True)
        if number % columns == 0:
            axes.set_ylabel(up)
    # Matplotlib's own containers are legend handles, and its types do not say so.
    handles = cast("list[Artist]", list(named.values()))
    figure.legend(handles, list(named), loc="outside lower center", ncols=min(len(named), legend_columns), fontsize=8)
    return figure


def _draw(axes: Axes, line: Line) -> object:
    """Draw one line, and return what stands for it in a legend."""
    match line.form:
        case "level":
            return axes.axhline(line.y[0], color=line.colour, linestyle="--", linewidth=1.2)
        case "bar":
            return axes.bar(line.x, line.y, yerr=line.half, width=0.8, color=line.colour, ecolor="#444444", capsize=2)
        case "mark":
            return axes.errorbar(
                line.x,
                line.y,
                yerr=line.half,
                color=line.colour,
                marker=line.mark,
                linestyle="none",
                markersize=8,
                markerfacecolor="none",
                markeredgewidth=1.6,
                zorder=5,
            )
        case _:
            return axes.errorbar(
                line.x,
                line.y,
                yerr=line.half,
                color=line.colour,
                marker=line.mark,
                markersize=3.5,
                linewidth=1.2,
                elinewidth=0.8,
                capsize=1.5,
            )
