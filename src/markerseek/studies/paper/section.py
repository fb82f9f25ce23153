"""What the reproduction of one figure or table delivers: tables, numbers beside the paper's, pictures, plain words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import ConfigError
from markerseek.core.shapes import Float64
from markerseek.studies.paper.reported import SENSITIVE_DEG, Reported, reported
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of many searches, summed up.

    Attributes
    ----------
    count
        Number of searches.
    mean_deg, spread_deg
        Mean and standard deviation of the absolute error in degrees; the spread of one search is None.
    half_deg
        Half the width of the 95 % interval of the mean in degrees; None for one search.
    failed
        Share of searches that are off by more than the sensitive range, 4.33°.
    """

    count: int
    mean_deg: float
    spread_deg: float | None
    half_deg: float | None
    failed: float


def errors_of(error_deg: Float64[np.ndarray, " searches"]) -> Errors:
    """Summary of the absolute errors of one search or more, in degrees."""
    if error_deg.size == 0:
        raise ConfigError("errors: there are none to be summed up; run one search at least")
    moments = Moments.of(error_deg.tolist())
    interval = moments.interval
    return Errors(
        count=moments.count,
        mean_deg=moments.mean,
        spread_deg=moments.sd,
        half_deg=None if interval is None else (interval[1] - interval[0]) / 2,
        failed=float(np.mean(error_deg > SENSITIVE_DEG)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Beside:
    """A number of the paper and the same one of ours.

    Attributes
    ----------
    paper
        The paper's.
    ours, spread
        Ours, and what stands behind its ±.
    half
        Half the width of the 95 % interval of ours; None where there is none.
    failed
        Share of our searches that are off by more than 4.33°; None where that is no question.
    condition
        Under what ours was found, such as a noise; empty where there is one only.
    """

    paper: Reported
    ours: float
    spread: float | None = None
    half: float | None = None
    failed: float | None = None
    condition: str = ""

    @property
    def difference(self) -> float:
        """Ours less the paper's."""
        return self.ours - self.paper.mean


def beside(key: str, ours: Errors, *, condition: str = "") -> Beside:
    """Our errors beside the paper's number of that key."""
    return Beside(
        paper=reported(key),
        ours=ours.mean_deg,
        spread=ours.spread_deg,
        half=ours.half_deg,
        failed=ours.failed,
        condition=condition,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A picture that is drawn when it is wanted.

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
    besides
        The paper's numbers beside ours.
    tables, pictures
        See the classes.
    remarks
        Plain sentences about what it shows and what cannot be had.
    """

    name: str
    title: str
    method: tuple[str, ...]
    besides: tuple[Beside, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    remarks: tuple[str, ...] = field(default=())
