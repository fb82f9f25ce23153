"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, a picture.

`errors_figure` is the picture of errors over acquisitions, with the colours and marks of the methods.

The text is in `prose.toml`; results stand in it as fields of `str.format`.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from markerseek.pictures import panel_grid, shared_legend
from markerseek.studies.figure import draw_means
from markerseek.studies.paper.methods import ALL_METHODS, Answer, AnyMethod, PaperSearch
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
    return Table(name=name, caption=caption, columns=tuple(columns.split()), rows=tuple(rows), shown=shown)


class Errors(NamedTuple):
    """Summary of the absolute errors of many searches."""

    error_deg: Mean
    failed: float
    """Share of searches with an error beyond `SENSITIVE_DEG`, whether they claim their angle or not."""
    unclaimed: float
    """Share of searches that claim no angle: not found, at bound, ambiguous or unsure."""
    claimed_failed: float
    """Share of searches that claim an angle with an error beyond `SENSITIVE_DEG`."""

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Cells of a table under `ERRORS`."""
        mean, *shares = self
        return (mean.count, mean.mean, mean.sd, mean.half, *shares)


ERRORS = (
    "searches mean_error_deg spread_deg half_interval95_deg share_off_by_more_than_4.33_deg share_without_a_claim "
    "claimed_and_off_by_more_than_4.33_deg"
)
"""Columns of `Errors`."""

Group: TypeAlias = tuple[str, float | None, AnyMethod, int]
"""What was searched, peak SNR, method, number of acquisitions."""


def errors_of(answers: Iterable[Answer]) -> Errors:
    """Summary of one answer or more."""
    of_all = list(answers)
    errors = np.array([each.error_deg for each in of_all])
    claimed = np.array([each.claimed for each in of_all])
    return Errors(
        error_deg=Mean.of(errors.tolist()),
        failed=float(np.mean(errors > SENSITIVE_DEG)),
        unclaimed=float(np.mean(~claimed)),
        claimed_failed=float(np.mean(claimed & (errors > SENSITIVE_DEG))),
    )


def errors_by_group(searches: Iterable[PaperSearch]) -> dict[Group, Errors]:
    """Errors of every number of acquisitions, by group."""
    groups: dict[Group, list[Answer]] = {}
    for each in searches:
        for count, answer in each.answers.items():
            groups.setdefault((each.place, each.peak_snr_db, each.method, count), []).append(answer)
    return {group: errors_of(found) for group, found in groups.items()}


def errors_table(name: str, caption: str, place: str, errors: Mapping[Group, Errors], *, shown: bool = False) -> Table:
    """Table of the errors of groups of searches; ``place``: what the first column is called."""
    rows = ((*group, *each.cells) for group, each in errors.items())
    return make_table(name, caption, f"{place} peak_snr_db method acquisitions {ERRORS}", rows, shown=shown)


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


def compared(number: str, ours: Errors, *, condition: str = "", of_paper: bool = True) -> Comparison:
    """Return our errors beside the paper's number with that key; or, if it has none, under a name of our own."""
    return Comparison(
        paper=paper_number(number) if of_paper else PaperNumber(quantity=number),
        ours=ours.error_deg.mean or 0.0,
        sd=ours.error_deg.sd,
        half=ours.error_deg.half,
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
    method: tuple[str, ...] = ()
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
    name: str, *, method: tuple[str, ...] = (), results: Mapping[str, object] = MappingProxyType({}), **parts: Any
) -> Section:
    """Return a section with its text.

    ``method``: headings whose paragraphs come first. ``results``: values of the fields of the text. ``parts``: its
    comparisons, tables and picture.
    """
    prose = _prose()
    text = prose[name]

    def paragraphs(part: str) -> tuple[str, ...]:
        return tuple(" ".join(each.split()).format(**results) for each in part.split("\n\n") if each.strip())

    return Section(
        name=name,
        title=text["title"].format(**results),
        method=paragraphs("\n\n".join(prose[heading].get("method", "") for heading in (*method, name))),
        alt=text.get("alt", ""),
        remarks=paragraphs(text.get("remarks", "")),
        **parts,
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

    place: str
    peak_snr_db: float | None
    title: str
    printed_deg: Mapping[tuple[AnyMethod, int], float]
    """Mean errors that the paper prints, by method and number of acquisitions."""


def errors_figure(
    errors: Mapping[Group, Errors],
    panels: Iterable[Panel],
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
    panels = list(panels)
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
            group = (panel.place, panel.peak_snr_db, name)
            ours = {count: each.error_deg for (*of, count), each in errors.items() if tuple(of) == group}
            style: dict[str, Any] = {"color": COLOURS[name], "marker": MARKS[name]}
            if ours:
                label = "posterior (ours, not in the paper)" if name == "posterior" else f"{name}, ours"
                draw_means(axes, ours, label=label, **style)
            theirs = {count: value for (method, count), value in panel.printed_deg.items() if method == name}
            if theirs:
                style |= {"linestyle": "none", "markersize": 8, "markerfacecolor": "none", "markeredgewidth": 1.6}
                axes.plot(*zip(*theirs.items(), strict=True), label=f"{name}, {printed}", zorder=5, **style)
        if average_deg is not None:
            axes.axhline(
                average_deg, color=COLOURS["WA"], linestyle="--", linewidth=1.2, label="WA, paper (mean over N)"
            )
    shared_legend(figure, columns=4)
    return figure
