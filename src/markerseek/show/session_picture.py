"""Figures of a registration session: its markers over the images of both cameras, and its error marker by marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float64, UInt8
from markerseek.show.style import ACCENT, GRID, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect

Pixel = tuple[float, float]

_CHI95 = 2.4477
"""Half axes of the ellipse that holds 95 % of a Gaussian distribution in two dimensions, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraView:
    """What one camera saw."""

    title: str
    image: UInt8[np.ndarray, "rows columns"] | UInt8[np.ndarray, "rows columns 3"] | None
    """The image, colours in the order of OpenCV; None: it was not kept."""
    size_px: tuple[int, int]
    """Width and height."""
    used: Mapping[str, Pixel]
    others: Mapping[str, Pixel]
    """``used`` and ``others``: the spots of the markers by their names, those that count and those that do not."""
    checks: Mapping[str, Pixel]
    """Spots that checked the registration."""
    target: tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"]] | None
    """The target and its covariance in square pixels; None: it is not known."""


def markers_figure(views: Sequence[CameraView], *, title: str) -> Figure:
    """Return the figure of the spots over the images of both cameras, and of the target with its 95 % ellipse."""
    figure = new_figure(width_in=10.5, height_in=4.9 * (len(views) // 2), heading=title)
    for axes, view in zip(figure.subplots(len(views) // 2, 2, squeeze=False).flat, views, strict=True):
        _draw_view(axes, view)
    shared_legend(figure)
    return figure


def _draw_view(axes: Axes, view: CameraView) -> None:
    width, height = view.size_px
    axes.set_title(view.title, fontsize=10)
    if view.image is not None:
        image = view.image if view.image.ndim == 2 else view.image[:, :, ::-1]
        axes.imshow(image, cmap="gray", vmin=0, vmax=255, extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    _draw_spots(axes, view.used, label="marker", color=SIGNAL, marker="o")
    _draw_spots(axes, view.others, label="marker that does not count", color=QUIET, marker="o")
    _draw_spots(axes, view.checks, label="spot that checks", color=TRUTH, marker="s")
    if view.target is not None:
        _draw_target(axes, *view.target)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("column [px]")
    axes.set_ylabel("row [px]")


def _draw_spots(axes: Axes, spots: Mapping[str, Pixel], *, label: str, color: str, marker: str) -> None:
    """Draw spots with their names, on light grounds and on dark ones."""
    for number, (name, (x, y)) in enumerate(spots.items()):
        ring = axes.plot(x, y, marker, ms=9, mfc="none", mec=color, mew=2, label=label if number == 0 else None)
        ring[0].set_path_effects(_outlined(4))
        text = axes.annotate(name, (x, y), xytext=(7, 7), textcoords="offset points", fontsize=9, color=color)
        text.set_path_effects(_outlined(2))


def _outlined(width: float) -> list[AbstractPathEffect]:
    from matplotlib import patheffects

    return [patheffects.withStroke(linewidth=width, foreground="white"), patheffects.Normal()]


def _draw_target(axes: Axes, pixel: Float64[np.ndarray, " 2"], covariance_px2: Float64[np.ndarray, "2 2"]) -> None:
    from matplotlib.patches import Ellipse

    squares, directions = np.linalg.eigh(covariance_px2)
    small, large = 2 * _CHI95 * np.sqrt(np.maximum(squares, 0.0))
    turn_deg = float(np.degrees(np.arctan2(directions[1, 1], directions[0, 1])))
    place = (float(pixel[0]), float(pixel[1]))
    patch = Ellipse(place, large, small, angle=turn_deg, fill=False, edgecolor=ACCENT, linewidth=2)
    patch.set_path_effects(_outlined(4))
    patch.set_zorder(4)
    axes.add_patch(patch)
    axes.plot(*place, "x", color=ACCENT, label="target, with the ellipse of 95 %", zorder=4)


def errors_figure(errors: Sequence[tuple[int, float, float]], *, goal_mm: float) -> Figure:
    """Return the figure of the expected error at the target after each marker, with its goal.

    ``errors``: as of `errors_svg`.
    """
    figure = new_figure(width_in=10.5, height_in=3.6, heading="expected error, marker by marker")
    axes = figure.subplots()
    markers = [count for count, _, _ in errors]
    axes.plot(markers, [mean for _, mean, _ in errors], "o-", color=SIGNAL, label="expected")
    axes.plot(markers, [high for _, _, high in errors], "_--", color=SIGNAL, label="95 % are below")
    axes.axhline(goal_mm, color=QUIET, linestyle=":", label=f"goal, {goal_mm:g} mm")
    axes.set_xticks(sorted({*markers}))
    axes.set_ylim(bottom=0)
    axes.set_xlabel("markers")
    axes.set_ylabel("error at the target [mm]")
    axes.grid(visible=True, color=GRID, linewidth=0.6)
    axes.legend(fontsize=8)
    return figure
