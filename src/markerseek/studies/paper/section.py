"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, a picture.

The paper's numbers are in `printed.csv`: value, place, and why a number cannot be reproduced. That file holds nothing
of ours; `compared` puts a number of ours beside one of them. The text is in `prose.toml`; results stand in it as fields
of `str.format`. `errors_figure` is the picture of errors over acquisitions, with the colours and marks of the methods.
"""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import msgspec
import numpy as np

from markerseek.core import ConfigError
from markerseek.show import panel_grid, shared_legend
from markerseek.studies.figure import draw_means
from markerseek.studies.paper.methods import PaperMethod, PaperSearch
from markerseek.studies.summary import Mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """One number of the paper; or, without a value, what a number of ours is for which the paper has none."""

    key: str = ""
    """Name by which the code refers to it."""
    place: str = "not in the paper"
    """Where in the paper it is."""
    quantity: str
    value: float | None = None
    sd: float | None = None
    """What the paper prints after ±."""
    unit: str = "deg"
    limitation: str | None = None
    """Why the number cannot be reproduced, or not fully; None if nothing is known against it."""
    note: str | None = None
    """What else is known of the number."""

    def __str__(self) -> str:
        if self.value is None:
            return "–"
        sd = "" if self.sd is None else f" ± {self.sd:g}"
        return f"{self.value:g}{sd} {self.unit}".replace(" deg", "°")


def _read() -> dict[str, PaperNumber]:
    lines = resources.files(__package__).joinpath("printed.csv").read_text(encoding="utf-8").splitlines()
    # An empty cell is a missing value.
    rows = [{name: cell or None for name, cell in row.items()} for row in csv.DictReader(lines)]
    return {number.key: number for number in msgspec.convert(rows, list[PaperNumber], strict=False)}


PAPER_NUMBERS = _read()
"""All numbers by key."""

MATERIALS = tuple(key.removeprefix("table1/WA/") for key in PAPER_NUMBERS if key.startswith("table1/WA/"))
"""Columns of Table 1."""


def paper_number(key: str) -> PaperNumber:
    """Return a number of the paper by its key."""
    if key not in PAPER_NUMBERS:
        raise ConfigError(f"printed: {key!r} is not a number of the paper; the keys are: {', '.join(PAPER_NUMBERS)}")
    return PAPER_NUMBERS[key]


def printed_value(key: str) -> float:
    """Return the value of a number of the paper."""
    return paper_number(key).value or math.nan


SENSITIVE_DEG = printed_value("sensitive")
"""Error beyond which the tool tip leaves the image: a search with a larger error counts as failed."""


TableCell: TypeAlias = str | int | float | None
"""One cell of a table; None is empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows under named columns, as they go into a CSV and into the report."""

    name: str
    """Stem of the CSV."""
    caption: str
    columns: tuple[str, ...]
    """Names of the columns, with their units."""
    rows: tuple[tuple[TableCell, ...], ...]
    shown: bool = True
    """Whether the report prints it; a long one is a file only."""


def make_table(
    name: str, caption: str, columns: str, rows: Iterable[tuple[TableCell, ...]], *, shown: bool = True
) -> Table:
    """Return a table; ``columns``: their names, separated by spaces."""
    return Table(name=name, caption=caption, columns=tuple(columns.split()), rows=tuple(rows), shown=shown)


class Errors(NamedTuple):
    """Summary of the absolute errors of many searches."""

    error_deg: Mean
    failed: float
    """Share of searches with an error beyond `SENSITIVE_DEG`."""

    @property
    def cells(self) -> tuple[TableCell, ...]:
        """Cells of a table under `ERROR_COLUMNS`."""
        mean = self.error_deg
        return mean.count, mean.mean, mean.sd, mean.half, self.failed


ERROR_COLUMNS = "searches mean_error_deg spread_deg half_interval95_deg share_off_by_more_than_4.33_deg"
"""Columns of `Errors`."""

Group: TypeAlias = tuple[str, float | None, PaperMethod, int]
"""What was searched, peak SNR, method, number of acquisitions."""


def errors_of(errors_deg: Sequence[float]) -> Errors:
    """Return the summary of one absolute error or more."""
    return Errors(Mean.of(errors_deg), float(np.mean(np.array(errors_deg) > SENSITIVE_DEG)))


def errors_by_group(searches: Iterable[PaperSearch]) -> dict[Group, Errors]:
    """Return the errors of every number of acquisitions, by group."""
    groups: dict[Group, list[float]] = {}
    for each in searches:
        for count in each.answers_deg:
            group = each.place, each.peak_snr_db, each.method, count
            groups.setdefault(group, []).append(each.error_deg(count))
    return {group: errors_of(found) for group, found in groups.items()}


def errors_table(name: str, caption: str, place: str, errors: Mapping[Group, Errors], *, shown: bool = False) -> Table:
    """Return the table of the errors of groups of searches; ``place``: what the first column is called."""
    rows = ((*group, *each.cells) for group, each in errors.items())
    return make_table(name, caption, f"{place} peak_snr_db method acquisitions {ERROR_COLUMNS}", rows, shown=shown)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A number of the paper and ours; or, of a user's own bank, ours alone."""

    paper: PaperNumber
    """The paper's number; of a user's own bank what is counted, in words."""
    ours: float
    sd: float | None = None
    half: float | None = None
    """Half the width of the 95 % interval of ours."""
    failed: float | None = None
    """Share of our searches with an error beyond `SENSITIVE_DEG`; None if it is no mean of errors."""
    condition: str = ""
    """Condition of ours, such as the noise; empty if there is only one."""

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
    """The paper's numbers beside ours."""
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
    """Return the text of each section by its name."""
    return tomllib.loads(resources.files(__package__).joinpath("prose.toml").read_text(encoding="utf-8"))


STYLES: dict[PaperMethod, dict[str, Any]] = {
    "TS": {"color": "#c8501e", "marker": "o"},
    "GSS": {"color": "#1f5fa8", "marker": "s"},
    "WA": {"color": "#2a7f3f", "marker": "^"},
}
"""Red, blue and green, as in Fig. 5 of the paper; the colour-blind can tell them apart by the marks too."""


class Panel(NamedTuple):
    """One panel of the figure."""

    place: str
    peak_snr_db: float | None
    title: str
    printed_deg: Mapping[tuple[PaperMethod, int], float]
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
    """Return the figure of the mean error over the number of acquisitions, with the 95 % interval of the mean.

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
        for name, style in STYLES.items():
            group = (panel.place, panel.peak_snr_db, name)
            ours = {count: each.error_deg for (*of, count), each in errors.items() if tuple(of) == group}
            if ours:
                draw_means(axes, ours, label=f"{name}, ours", **style)
            theirs = {count: value for (method, count), value in panel.printed_deg.items() if method == name}
            if theirs:
                large = {
                    **style,
                    "linestyle": "none",
                    "markersize": 8,
                    "markerfacecolor": "none",
                    "markeredgewidth": 1.6,
                }
                axes.plot(*zip(*theirs.items(), strict=True), label=f"{name}, {printed}", zorder=5, **large)
        if average_deg is not None:
            axes.axhline(
                average_deg, color=STYLES["WA"]["color"], linestyle="--", linewidth=1.2, label="WA, paper (mean over N)"
            )
    shared_legend(figure, columns=4)
    return figure
