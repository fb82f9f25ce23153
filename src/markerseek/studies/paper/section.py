"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, a picture.

`errors_figure` is the picture of errors over acquisitions, with the colours and marks of the methods.

The text is in `prose.toml`; results stand in it as fields of `str.format`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from markerseek.core import ConfigError, Estimate, Found
from markerseek.pictures import ERROR_BARS, panel_grid, shared_legend
from markerseek.studies.paper.methods import ALL_METHODS, AnyMethod, PaperMethod
from markerseek.studies.paper.printed import SENSITIVE_DEG, PaperNumber, paper_number
from markerseek.studies.statistics import Mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell: TypeAlias = str | int | float | None
"""One cell of a table; None is empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows under named columns, as they go into a CSV and into the report."""

    name: str
    """Stem of the CSV."""
    caption: str
    columns: tuple[str, ...]
    """Names of the columns, with their units."""
    rows: tuple[tuple[Cell, ...], ...]
    shown: bool = True
    """Whether the report prints it; a long one is a file only."""


def make_table(name: str, caption: str, columns: str, rows: Iterable[tuple[Cell, ...]], *, shown: bool = True) -> Table:
    """Return a table; ``columns``: their names, separated by spaces."""
    names, lines = tuple(columns.split()), tuple(rows)
    if any(len(line) != len(names) for line in lines):
        raise ConfigError(f"table {name}: a row has not the {len(names)} columns {columns}")
    return Table(name=name, caption=caption, columns=names, rows=lines, shown=shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Absolute error of an answer in degrees, and whether it claims its angle; the paper's methods always do."""

    error_deg: float
    claimed: bool = True

    @classmethod
    def of(cls, estimate: Estimate, *, truth_deg: float) -> Answer:
        """Answer of an estimate: it claims its angle if it is `Found`."""
        return cls(error_deg=abs(estimate.mean_deg - truth_deg), claimed=isinstance(estimate, Found))


class Errors(NamedTuple):
    """Summary of the errors of many searches; the cells of a table under `ERRORS`."""

    searches: int
    mean_deg: float
    """Mean of the absolute error."""
    sd_deg: float | None
    """Standard deviation of the absolute error; None for one search."""
    half_deg: float | None
    """Half the width of the 95 % interval of the mean; None for one search."""
    failed: float
    """Share of searches with an error beyond `SENSITIVE_DEG`, whether they claim their angle or not."""
    unclaimed: float
    """Share of searches that claim no angle: not found, at bound, ambiguous or unsure."""
    claimed_failed: float
    """Share of searches that claim an angle with an error beyond `SENSITIVE_DEG`."""


ERRORS = (
    "searches mean_error_deg spread_deg half_interval95_deg share_off_by_more_than_4.33_deg share_without_a_claim "
    "claimed_and_off_by_more_than_4.33_deg"
)
"""Columns of `Errors`."""


def errors_of(errors_deg: Iterable[float]) -> Errors:
    """Summary of the absolute errors of searches that claim their angle, in degrees."""
    return summary_of(Answer(error_deg=error_deg) for error_deg in errors_deg)


def summary_of(answers: Iterable[Answer]) -> Errors:
    """Summary of one answer or more."""
    of_all = list(answers)
    errors = np.array([each.error_deg for each in of_all])
    if errors.size == 0:
        raise ConfigError("errors: there is no search to summarise; run at least one")
    claimed = np.array([each.claimed for each in of_all])
    mean = Mean.of(errors.tolist())
    return Errors(
        searches=mean.count,
        mean_deg=float(np.mean(errors)),
        sd_deg=mean.sd,
        half_deg=mean.half,
        failed=float(np.mean(errors > SENSITIVE_DEG)),
        unclaimed=float(np.mean(~claimed)),
        claimed_failed=float(np.mean(claimed & (errors > SENSITIVE_DEG))),
    )


def errors_table(
    name: str, caption: str, columns: str, errors: Mapping[tuple[Any, ...], Errors], *, shown: bool = False
) -> Table:
    """Table of the errors of groups of searches, whose names go into the first columns."""
    rows = ((*group, *each) for group, each in errors.items())
    return make_table(name, caption, f"{columns} {ERRORS}", rows, shown=shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A number of the paper and ours; or, of the posterior, ours alone."""

    paper: PaperNumber
    """The paper's number; of the posterior what is counted, in words."""
    ours: float
    sd: float | None = None
    half: float | None = None
    """Half the width of the 95 % interval of ours."""
    failed: float | None = None
    """Share of our searches with an error beyond `SENSITIVE_DEG`; None if it is no mean of errors."""
    unclaimed: float | None = None
    """Share of our searches that claim no angle; None if it is no mean of errors."""
    condition: str = ""
    """Condition of ours, such as the noise; empty where there is only one."""

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's; None if the paper has none."""
        return None if self.paper.value is None else self.ours - self.paper.value


def compared(number: str | PaperNumber, ours: Errors, *, condition: str = "") -> Comparison:
    """Return our errors beside the paper's number with that key, or under a name of our own."""
    return Comparison(
        paper=paper_number(number) if isinstance(number, str) else number,
        ours=ours.mean_deg,
        sd=ours.sd_deg,
        half=ours.half_deg,
        failed=ours.failed,
        unclaimed=ours.unclaimed,
        condition=condition,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """One figure or table, reproduced."""

    name: str
    """Its name on the command line, and the stem of the picture's files."""
    title: str
    method: tuple[str, ...]
    """What was done, in paragraphs."""
    comparisons: tuple[Comparison, ...] = ()
    """The paper's numbers beside ours, and those of the posterior."""
    tables: tuple[Table, ...] = ()
    draw: Callable[[], Figure] | None = None
    """Makes the picture; None if there is no picture."""
    alt: str = ""
    """What the picture shows, in words."""
    remarks: tuple[str, ...] = ()
    """Sentences about the results and their limits."""


def make_section(
    name: str,
    *,
    method: tuple[str, ...] = (),
    comparisons: tuple[Comparison, ...] = (),
    tables: tuple[Table, ...] = (),
    draw: Callable[[], Figure] | None = None,
    **results: object,
) -> Section:
    """Return a section with its text.

    ``method``: headings whose paragraphs come first. ``results``: values of the fields of the text.
    """
    prose = _prose()
    text = prose[name]

    def paragraphs(part: str) -> tuple[str, ...]:
        return tuple(" ".join(each.split()).format(**results) for each in part.split("\n\n") if each.strip())

    return Section(
        name=name,
        title=text["title"].format(**results),
        method=paragraphs("\n\n".join(prose[heading].get("method", "") for heading in (*method, name))),
        comparisons=comparisons,
        tables=tables,
        draw=draw,
        alt=text.get("alt", ""),
        remarks=paragraphs(text.get("remarks", "")),
    )


@cache
def _prose() -> dict[str, dict[str, str]]:
    """The text of each section by its name."""
    return tomllib.loads(resources.files(__package__).joinpath("prose.toml").read_text(encoding="utf-8"))


COLOURS: dict[AnyMethod, str] = {"TS": "#c8501e", "GSS": "#1f5fa8", "WA": "#2a7f3f", "posterior": "#5b2a86"}
"""Red, blue and green, as in Fig. 5 of the paper, and violet; the colour-blind can tell them apart by the marks too."""

MARKS: dict[AnyMethod, str] = {"TS": "o", "GSS": "s", "WA": "^", "posterior": "D"}


class Panel(NamedTuple):
    """One panel of the figure."""

    title: str
    errors: Mapping[tuple[AnyMethod, int], Errors]
    """Ours, by method and number of acquisitions."""
    printed_deg: Mapping[tuple[PaperMethod, int], float]
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
    if errors.half_deg is None or errors.searches < 5:
        return 0.0
    # Errors are positive: below 0.05 of the mean a logarithmic axis would show the bar and little else.
    return min(errors.half_deg, 0.95 * errors.mean_deg)
