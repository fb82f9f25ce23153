"""Maps of one number over two settings: a grid of coloured cells, each with its number written in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import ConfigError
from markerseek.pictures.canvas import new_figure, put_heading

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class HeatMap:
    """One map.

    Attributes
    ----------
    title
        What it shows.
    across, up
        Names of the columns from the left and of the rows from below.
    values
        Shares between 0 and 1, row by row from below.
    texts
        What is written in each cell, likewise.
    """

    title: str
    across: tuple[str, ...]
    up: tuple[str, ...]
    values: tuple[tuple[float, ...], ...]
    texts: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for rows in (self.values, self.texts):
            if len(rows) != len(self.up) or any(len(row) != len(self.across) for row in rows):
                raise ConfigError(
                    f"heat map {self.title!r}: {len(self.up)} rows of {len(self.across)} cells are needed"
                )


def heat_maps_figure(maps: Sequence[HeatMap], *, title: str, across: str, up: str, columns: int = 2) -> Figure:
    """Figure of maps with the same settings along their axes.

    Parameters
    ----------
    maps
        What is drawn, row by row.
    title
        Heading.
    across, up
        Labels of the axes.
    columns
        Maps in a row.
    """
    rows = -(-len(maps) // columns)
    wide, high = 0.62 * len(maps[0].across) + 1.2, 0.42 * len(maps[0].up) + 1.0
    figure = new_figure(width_in=wide * min(columns, len(maps)), height_in=high * rows + 0.5)
    put_heading(figure, title)
    grid = figure.subplots(rows, min(columns, len(maps)), squeeze=False)
    for axes in grid.flat[len(maps) :]:
        axes.set_axis_off()
    for axes, each in zip(grid.flat, maps, strict=False):
        values = np.array(each.values)
        axes.imshow(values, origin="lower", cmap="Blues", vmin=0, vmax=1, aspect="auto")
        axes.set_title(each.title, fontsize=10)
        axes.set_xticks(range(len(each.across)), each.across)
        axes.set_yticks(range(len(each.up)), each.up)
        axes.set_xlabel(across)
        axes.set_ylabel(up)
        for (row, column), value in np.ndenumerate(values):
            colour = "white" if value > 0.6 else "#1c2026"
            axes.text(column, row, each.texts[row][column], ha="center", va="center", fontsize=8, color=colour)
    return figure
