"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from markerseek.core import ConfigError
from markerseek.studies.paper.printed import SENSITIVE_DEG, PaperNumber, paper_number
from markerseek.studies.statistics import Moments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell: TypeAlias = str | int | float | None
"""One cell of a table; None is empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows under named columns, as they go into a CSV and into the report.

    Attributes
    ----------
    name
        Stem of the CSV.
    caption
        What it holds.
    columns
        Names, with units.
    rows
        As many cells each as there are columns.
    shown
        Whether the report prints it; a long one is a file only.
    """

    name: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    shown: bool = True

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.columns):
                raise ConfigError(
                    f"table {self.name}: row {number} has {len(row)} cells for {len(self.columns)} columns"
                )


Item = TypeVar("Item")


def table_of(
    items: Iterable[Item], cells: Mapping[str, Callable[[Item], Cell]], *, name: str, caption: str, shown: bool = True
) -> Table:
    """Return a table with a row for each item.

    Parameters
    ----------
    items
        What the rows are of.
    cells
        By the name of each column, the function that takes its cell from an item.
    name, caption, shown
        As for `Table`.
    """
    rows = tuple(tuple(cell(item) for cell in cells.values()) for item in items)
    return Table(name=name, caption=caption, columns=tuple(cells), rows=rows, shown=shown)


ERROR_COLUMNS = (
    "searches",
    "mean_error_deg",
    "spread_deg",
    "half_interval95_deg",
    "share_off_by_more_than_4.33_deg",
)
"""Columns of `Errors.cells`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Summary of the errors of many searches.

    Attributes
    ----------
    count
        Number of searches.
    mean_deg, sd_deg
        Mean and standard deviation of the absolute error in degrees; the latter is None for one search.
    half_deg
        Half the width of the 95 % interval of the mean in degrees; None for one search.
    failed
        Share of searches with an error beyond `SENSITIVE_DEG`.
    """

    count: int
    mean_deg: float
    sd_deg: float | None
    half_deg: float | None
    failed: float

    @property
    def cells(self) -> tuple[Cell, ...]:
        """The summary as cells under `ERROR_COLUMNS`."""
        return self.count, self.mean_deg, self.sd_deg, self.half_deg, self.failed


def errors_of(errors_deg: Iterable[float]) -> Errors:
    """Summary of the absolute errors of one search or more, in degrees."""
    errors = np.array(list(errors_deg))
    if errors.size == 0:
        raise ConfigError("errors: there is no search to summarise; run at least one")
    moments = Moments.of(errors.tolist())
    interval = moments.interval
    return Errors(
        count=moments.count,
        mean_deg=moments.mean,
        sd_deg=moments.sd,
        half_deg=None if interval is None else (interval[1] - interval[0]) / 2,
        failed=float(np.mean(errors > SENSITIVE_DEG)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A number of the paper and ours.

    Attributes
    ----------
    paper
        The paper's.
    ours, sd
        Ours, and its standard deviation.
    half
        Half the width of the 95 % interval of ours; None where there is none.
    failed
        Share of our searches with an error beyond `SENSITIVE_DEG`; None where it is no mean of errors.
    condition
        Condition of ours, such as the noise; empty where there is only one.
    """

    paper: PaperNumber
    ours: float
    sd: float | None = None
    half: float | None = None
    failed: float | None = None
    condition: str = ""

    @property
    def difference(self) -> float:
        """Ours minus the paper's."""
        return self.ours - self.paper.value


def compared(key: str, ours: Errors, *, condition: str = "") -> Comparison:
    """Return our errors beside the paper's number with that key."""
    return Comparison(
        paper=paper_number(key),
        ours=ours.mean_deg,
        sd=ours.sd_deg,
        half=ours.half_deg,
        failed=ours.failed,
        condition=condition,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture, drawn on demand.

    Attributes
    ----------
    name
        Stem of its files.
    alt
        What it shows, in words.
    draw
        Makes the figure.
    """

    name: str
    alt: str
    draw: Callable[[], Figure]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Section:
    """One figure or table, reproduced.

    Attributes
    ----------
    name
        Its name on the command line.
    title
        Its heading.
    method
        What was done, in paragraphs.
    comparisons
        The paper's numbers beside ours.
    tables, pictures
        See the classes.
    remarks
        Sentences about the results and their limits.
    """

    name: str
    title: str
    method: tuple[str, ...]
    comparisons: tuple[Comparison, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    remarks: tuple[str, ...] = ()
