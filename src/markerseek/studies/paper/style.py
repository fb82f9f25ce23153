"""Colours and marks of the methods in all figures of the paper, and the figure of errors over acquisitions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from markerseek.pictures import ERROR_BARS, panel_grid, shared_legend
from markerseek.studies.paper.methods import ALL_METHODS, AnyMethod, PaperMethod
from markerseek.studies.paper.section import Errors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS: dict[AnyMethod, str] = {"TS": "#c8501e", "GSS": "#1f5fa8", "WA": "#2a7f3f", "posterior": "#5b2a86"}
"""Red, blue and green, as in Fig. 5 of the paper, and violet; the colour-blind can tell them apart by the marks too."""

MARKS: dict[AnyMethod, str] = {"TS": "o", "GSS": "s", "WA": "^", "posterior": "D"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One panel of the figure."""

    title: str
    errors: Mapping[tuple[AnyMethod, int], Errors]
    """Ours, by method and number of acquisitions."""
    printed_deg: Mapping[tuple[PaperMethod, int], float] = field(default_factory=dict)
    """Mean errors that the paper prints, likewise."""


def errors_figure(
    panels: Sequence[Panel],
    *,
    heading: str,
    columns: int,
    panel_in: tuple[float, float],
    printed: str = "paper",
    average_deg: float | None = None,
) -> Figure:
    """Figure of the mean error over the number of acquisitions, with the 95 % interval of the mean.

    ``printed``: what the legend calls the paper's numbers, which are open marks. ``average_deg``: the paper's mean
    error of WA over all N, as a line; None draws none.
    """
    figure, grid = panel_grid(
        [panel.title for panel in panels],
        heading=heading,
        x_label="acquisitions N",
        y_label="mean error [deg]",
        columns=columns,
        panel_in=panel_in,
        y_scale="log",
    )
    for axes, panel in zip(grid, panels, strict=True):
        for name in ALL_METHODS:
            ours = {count: each for (method, count), each in panel.errors.items() if method == name}
            if ours:
                axes.errorbar(
                    list(ours),
                    [errors.mean_deg for errors in ours.values()],
                    yerr=[_drawn_half(errors) for errors in ours.values()],
                    label="posterior (ours, not in the paper)" if name == "posterior" else f"{name}, ours",
                    color=COLOURS[name],
                    marker=MARKS[name],
                    **ERROR_BARS,
                )
            theirs = {count: value for (method, count), value in panel.printed_deg.items() if method == name}
            if theirs:
                axes.plot(
                    list(theirs),
                    list(theirs.values()),
                    label=f"{name}, {printed}",
                    color=COLOURS[name],
                    marker=MARKS[name],
                    linestyle="none",
                    markersize=8,
                    markerfacecolor="none",
                    markeredgewidth=1.6,
                    zorder=5,
                )
        if average_deg is not None:
            axes.axhline(
                average_deg, color=COLOURS["WA"], linestyle="--", linewidth=1.2, label="WA, paper (mean over N)"
            )
    shared_legend(figure, columns=4)
    return figure


def _drawn_half(errors: Errors) -> float:
    """Half the interval. A logarithmic scale ends above 0; the interval of fewer than five searches means nothing."""
    if errors.half_deg is None or errors.count < 5:
        return 0.0
    # Errors are positive: below 0.05 of the mean a logarithmic axis would show the bar and little else.
    return min(errors.half_deg, 0.95 * errors.mean_deg)
