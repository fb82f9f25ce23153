"""Colours and marks of the methods in all figures of the paper, and how errors are drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from markerseek.pictures import ERROR_BARS
from markerseek.studies.paper.methods import AnyMethod, PaperMethod
from markerseek.studies.paper.section import Errors

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS: dict[AnyMethod, str] = {"TS": "#c8501e", "GSS": "#1f5fa8", "WA": "#2a7f3f", "posterior": "#5b2a86"}
"""Red, blue and green, as in Fig. 5 of the paper, and violet; the colour-blind can tell them apart by the marks too."""

MARKS: dict[AnyMethod, str] = {"TS": "o", "GSS": "s", "WA": "^", "posterior": "D"}


def draw_errors(axes: Axes, name: AnyMethod, by_count: Mapping[int, Errors]) -> None:
    """Draw the mean error of a method over the number of acquisitions, with the 95 % interval of the mean.

    Parameters
    ----------
    axes
        Where to draw.
    name
        The method.
    by_count
        Errors by number of acquisitions.
    """
    axes.errorbar(
        list(by_count),
        [errors.mean_deg for errors in by_count.values()],
        yerr=[_drawn_half(errors) for errors in by_count.values()],
        label="posterior (ours, not in the paper)" if name == "posterior" else f"{name}, ours",
        color=COLOURS[name],
        marker=MARKS[name],
        **ERROR_BARS,
    )


def draw_paper(axes: Axes, name: PaperMethod, counts: Sequence[int], values_deg: Sequence[float], label: str) -> None:
    """Draw numbers of the paper as open marks over the number of acquisitions.

    Parameters
    ----------
    axes
        Where to draw.
    name
        The method.
    counts, values_deg
        Acquisitions, and the paper's mean errors in degrees.
    label
        Name in the legend.
    """
    axes.plot(
        counts,
        values_deg,
        label=label,
        color=COLOURS[name],
        marker=MARKS[name],
        linestyle="none",
        markersize=8,
        markerfacecolor="none",
        markeredgewidth=1.6,
        zorder=5,
    )


def _drawn_half(errors: Errors) -> float:
    """Half the interval. A logarithmic scale ends above 0; the interval of fewer than five searches means nothing."""
    if errors.half_deg is None or errors.count < 5:
        return 0.0
    # Errors are positive: below 0.05 of the mean a logarithmic axis would show the bar and little else.
    return min(errors.half_deg, 0.95 * errors.mean_deg)
