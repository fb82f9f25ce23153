"""Figure of a registration: the points of both systems in the TRUS frame, from above and from the end of the probe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.core import Float64
from markerseek.show.style import ACCENT, GRID, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EXAGGERATION = 10
"""Factor by which the residuals are drawn longer than they are."""

_VIEWS = (("from above", 0, 1), ("along the axis of the probe", 0, 2))


def registration_figure(
    trus_m: Float64[np.ndarray, "points 3"],
    transformed_m: Float64[np.ndarray, "points 3"],
    *,
    names: Sequence[str],
    target_m: Sequence[float],
    title: str,
    checks: Mapping[str, tuple[Sequence[float], Sequence[float]]] | None = None,
) -> Figure:
    """Return the figure of one registration.

    ``trus_m``, ``transformed_m``: the points in the TRUS frame, as the searches found them and as the transformed
    camera points. ``target_m``: where the target registration error is given, in the TRUS frame. ``title``: what was
    registered, and how well. ``checks``: spots that took no part, by their names, in the same two ways.
    """
    figure = new_figure(width_in=10.5, height_in=5.2, heading=title)
    for axes, (view, across, up) in zip(figure.subplots(1, 2), _VIEWS, strict=True):
        x = 1e3 * trus_m[:, across]
        y = 1e3 * trus_m[:, up]
        far = 1e3 * (trus_m + EXAGGERATION * (transformed_m - trus_m))
        for number in range(len(trus_m)):
            label = f"residual, {EXAGGERATION} times as long" if number == 0 else None
            axes.plot([x[number], far[number, across]], [y[number], far[number, up]], color=ACCENT, label=label)
            axes.annotate(names[number], (x[number], y[number]), xytext=(6, 6), textcoords="offset points", fontsize=8)
        axes.scatter(x, y, color=SIGNAL, s=36, zorder=3, label="marker found by the probe")
        axes.scatter(
            [1e3 * target_m[across]], [1e3 * target_m[up]], color=QUIET, marker="x", s=60, label="target of the TRE"
        )
        for number, (name, (found_m, there_m)) in enumerate((checks or {}).items()):
            place_mm = 1e3 * np.array(found_m)
            far_mm = place_mm + 1e3 * EXAGGERATION * (np.array(there_m) - found_m)
            axes.plot([place_mm[across], far_mm[across]], [place_mm[up], far_mm[up]], color=ACCENT)
            label = "marker that checks it" if number == 0 else None
            axes.plot(place_mm[across], place_mm[up], "s", color=TRUTH, label=label)
            place = (place_mm[across], place_mm[up])
            axes.annotate(name, place, xytext=(6, 6), textcoords="offset points", fontsize=8)
        axes.set_title(view, fontsize=10)
        axes.set_xlabel(f"{'xyz'[across]} [mm]")
        axes.set_ylabel(f"{'xyz'[up]} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        axes.grid(visible=True, color=GRID, linewidth=0.6)
        axes.set_axisbelow(True)
    shared_legend(figure)
    return figure
