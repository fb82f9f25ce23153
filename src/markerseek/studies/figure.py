"""Figure of the mean errors of studies over the number of acquisitions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from markerseek.core import ConfigError
from markerseek.show import ERROR_BARS, panel_grid, shared_legend
from markerseek.studies.policies import StudyPolicy
from markerseek.studies.study import Study
from markerseek.studies.summary import Mean, Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = (
    "#1f5fa8", "#c8501e", "#2a7f3f", "#8b4fa8",
    "#b8860b", "#3a9bb0", "#a83f5b", "#5b6b2f",
    "#7a5230", "#4a4a4a", "#d08fb0", "#98a42c"
)  # fmt: skip

_MARKS = "osD^v<>pXhP*"


def error_figure(
    runs: Sequence[tuple[Study, Summary]],
    *,
    bounds: Mapping[int, tuple[Sequence[int], Sequence[float]]] = MappingProxyType({}),
) -> Figure:
    """Return the figure of the mean errors of all searches, whatever their answer, with 95 % intervals.

    A policy with marks has a point at each mark up to its number of acquisitions; policies that differ only in that
    number and have no marks below it share a line. Points without a line at one number are spread around it.

    ``runs``: cells with the same index share a panel. ``bounds``: numbers of acquisitions and mean errors at a bound,
    by cell. Raises `ConfigError` if nothing can be drawn: there are no marks and no markers.
    """
    settings = {policy.cell: policy.settings for policy in runs[0][1].policies}
    figure, panels = panel_grid(
        [
            ", ".join(f"{key.rpartition('.')[2]} = {value}" for key, value in varied.items())
            for varied in settings.values()
        ],
        heading=f"mean error, whatever the answer ({_markers(runs)} simulated markers)",
        x_label="acquisitions, at most",
        y_label="mean error, degrees",
        columns=2,
        panel_in=(7.6, 4.6) if len(settings) == 1 else (5.0, 4.2),
        y_scale="log",
    )
    for axes, cell in zip(panels, settings, strict=True):
        lines = [line for study, summary in runs for line in _lines(study, summary, cell).items()]
        if not lines and cell not in bounds:
            raise ConfigError("figure: the study has no marks and no errors to draw; give it marks")
        offsets = _offsets([list(means) for _, means in lines])
        for number, ((label, means), offset) in enumerate(zip(lines, offsets, strict=True)):
            # Colour and mark change together, for readers who do not distinguish the colours.
            style = {"color": _COLOURS[number % 12], "marker": _MARKS[number % 12]}
            draw_means(axes, means, offset=offset, label=label, **style)
        axes.locator_params(axis="x", integer=True, min_n_ticks=1)
        if cell in bounds:
            axes.errorbar(*bounds[cell], label="bound, best angles", color="#000000", marker="_", **ERROR_BARS)
    shared_legend(figure, columns=2)
    return figure


def _lines(study: Study, summary: Summary, cell: int) -> dict[str, dict[int, Mean]]:
    """Return the means by number of acquisitions, rising, of each line of a cell by its label."""
    lines: dict[str, dict[int, Mean]] = {}
    for each in summary.policies:
        if each.cell == cell:
            policy = study.policies[each.policy]
            means = lines.setdefault(_name(each.label, policy), {})
            # Of other methods half a search is not a search of half as many.
            if policy.plan.method not in ("weighted-average", "exhaustive", "manual"):
                means.update(zip(study.marks, each.marks_deg, strict=True))
            means[policy.most] = each.any_error_deg
    known = {
        # Policies of one line may be listed in any order; the line must run to the right.
        name: {count: mean for count, mean in sorted(means.items(), key=lambda item: item[0]) if mean.mean is not None}
        for name, means in lines.items()
    }
    return {name: means for name, means in known.items() if means}


def _offsets(lines: Sequence[Sequence[int]]) -> list[float]:
    """By how much each line is moved sideways: a point alone beside others at the same number of acquisitions."""
    alone = [line[0] if len(line) == 1 else None for line in lines]
    counts = [count for line in lines for count in line]
    step = 0.02 * (max(counts) - min(counts)) or 0.1
    # Around the number itself: three points are at -1, 0 and 1 steps from it.
    return [
        0.0 if count is None else step * (alone[:place].count(count) - (alone.count(count) - 1) / 2)
        for place, count in enumerate(alone)
    ]


def _markers(runs: Sequence[tuple[Study, Summary]]) -> str:
    """Return the markers behind each point, from the fewest to the most."""
    counts = sorted({policy.trials for _, summary in runs for policy in summary.policies})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"


def _name(label: str, policy: StudyPolicy) -> str:
    """Return the label of a policy without its number of acquisitions, and without the usual "no early end"."""
    name = label.replace(f", {policy.most}", "", 1).replace(", no early end", "")
    return f"{name}, with early end" if policy.plan.method == "posterior" and policy.plan.early_end else name


def draw_means(axes: Axes, means: Mapping[int, Mean], *, offset: float = 0.0, **style: Any) -> None:
    """Draw a line of means over numbers of acquisitions, with their 95 % intervals, on a logarithmic scale.

    ``offset``: by how much it is moved sideways. ``style``: label, colour and mark.
    """
    # The axis ends above 0, and shows little else than the bar below 0.05 of the mean.
    halves = [
        0.0 if mean.half is None or mean.mean is None else min(mean.half, 0.95 * mean.mean) for mean in means.values()
    ]
    axes.errorbar(
        [count + offset for count in means],
        [mean.mean or 0.0 for mean in means.values()],
        yerr=halves,
        **style,
        **ERROR_BARS,
    )
