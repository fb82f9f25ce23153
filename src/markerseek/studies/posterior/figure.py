"""The figure: mean error over the number of acquisitions, each policy a line, the bound below them all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from markerseek.core import ConfigError
from markerseek.pictures import Line, Panel, panels_figure
from markerseek.studies.statistics import Mean
from markerseek.studies.study import Study
from markerseek.studies.summary import Summary
from markerseek.studies.tally import PolicySummary

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (
    "#1f5fa8",
    "#c8501e",
    "#2a7f3f",
    "#8b4fa8",
    "#b8860b",
    "#3a9bb0",
    "#a83f5b",
    "#5b6b2f",
    "#7a5230",
    "#4a4a4a",
    "#d08fb0",
    "#98a42c",
)

_MARKS = "osD^v<>pXhP*"


def error_figure(
    runs: Sequence[tuple[Study, Summary]], *, bounds: Mapping[int, tuple[Sequence[int], Sequence[float]]]
) -> Figure:
    """Figure of the mean errors, whatever the answer, with their 95 % intervals.

    A policy with marks has a point at each mark up to its number of acquisitions; policies that differ in nothing but
    that number and have no marks below it share a line.

    Parameters
    ----------
    runs
        Studies and their summaries; cells of the same number share a panel.
    bounds
        Numbers of acquisitions and mean errors at the bound, by cell.

    Raises
    ------
    ConfigError
        If nothing can be drawn: there are no marks and no markers.
    """
    first = runs[0][1]
    panels = []
    for cell in sorted({policy.cell for policy in first.policies}):
        points = [line for study, summary in runs for line in _points(study, summary, cell)]
        lines = [
            Line(label=label, x=x, y=y, half=half, colour=_COLOURS[k % 12], mark=_MARKS[k % 12])
            for k, (label, x, y, half) in enumerate(points)
        ]
        if cell in bounds:
            counts, means = bounds[cell]
            lines.append(
                Line(
                    label="bound, best angles",
                    x=tuple(float(count) for count in counts),
                    y=tuple(means),
                    colour="#000000",
                    mark="_",
                )
            )
        if not lines:
            raise ConfigError("figure: the study has no marks and no errors to draw; give it marks")
        settings = next(policy.settings for policy in first.policies if policy.cell == cell)
        panels.append(Panel(title=", ".join(f"{key} = {value}" for key, value in settings.items()), lines=tuple(lines)))
    return panels_figure(
        panels,
        title=f"mean error, whatever the answer ({_markers(runs)} simulated markers)",
        across="acquisitions, at most",
        up="mean error, degrees",
        columns=2,
        scale="log",
        panel_in=(7.6, 4.6) if len(panels) == 1 else (5.0, 4.2),
        legend_columns=3,
    )


_Points = tuple[str, tuple[float, ...], tuple[float, ...], tuple[float, ...]]


def _points(study: Study, summary: Summary, cell: int) -> list[_Points]:
    """Label, numbers of acquisitions, means and half intervals of each line."""
    found: dict[str, dict[int, Mean]] = {}
    for policy in summary.policies:
        if policy.cell == cell:
            points = found.setdefault(_name(policy), {})
            if not _plans_ahead(policy):
                points.update(zip(study.marks, policy.marks_deg, strict=True))
            points[policy.acquisitions_most] = policy.any_error_deg
    lines = []
    for name, points in found.items():
        known = sorted((count, mean) for count, mean in points.items() if mean.mean is not None)
        if known:
            lines.append(
                (
                    name,
                    tuple(float(count) for count, _ in known),
                    tuple(mean.mean or 0.0 for _, mean in known),
                    tuple(_half(mean) for _, mean in known),
                )
            )
    return lines


def _markers(runs: Sequence[tuple[Study, Summary]]) -> str:
    """Markers behind each point, from the fewest to the most."""
    counts = sorted({policy.trials for _, summary in runs for policy in summary.policies})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"


def _plans_ahead(policy: PolicySummary) -> bool:
    """Whether its angles depend on how many there will be, so that half a search is not a search of half as many."""
    return policy.method in ("weighted-average", "exhaustive", "manual")


def _name(policy: PolicySummary) -> str:
    """The policy without its number of acquisitions; that it uses all of them goes without saying."""
    name = policy.label.replace(f", {policy.acquisitions_most}", "", 1).replace(", no early end", "")
    return f"{name}, ending by itself" if policy.method == "posterior" and policy.early_end else name


def _half(mean: Mean) -> float:
    """Half the interval, on a logarithmic scale not down to 0."""
    if mean.interval95 is None or mean.mean is None:
        return 0.0
    return min((mean.interval95[1] - mean.interval95[0]) / 2, 0.95 * mean.mean)
