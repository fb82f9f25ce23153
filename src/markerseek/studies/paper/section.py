"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import ConfigError, Estimate, Found
from markerseek.studies.paper.printed import SENSITIVE_DEG, OwnNumber, PaperNumber, paper_number
from markerseek.studies.statistics import Moments

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
    rows: tuple[dict[str, Cell], ...]
    """The cells of each row by the names of their columns, which have units; the same columns in each."""
    shown: bool = True
    """Whether the report prints it; a long one is a file only."""

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if tuple(row) != self.columns:
                here, first = ", ".join(row), ", ".join(self.columns)
                raise ConfigError(f"table {self.name}: row {number} has the columns {here}, row 1 has {first}")

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.rows[0]) if self.rows else ()

    @property
    def lines(self) -> tuple[tuple[Cell, ...], ...]:
        """The cells of each row, without their names."""
        return tuple(tuple(row.values()) for row in self.rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """Absolute error of an answer in degrees, and whether it claims its angle; the paper's methods always do."""

    error_deg: float
    claimed: bool = True

    @classmethod
    def of(cls, estimate: Estimate, *, truth_deg: float) -> Answer:
        """Answer of an estimate: it claims its angle if it is `Found`."""
        return cls(error_deg=abs(estimate.mean_deg - truth_deg), claimed=isinstance(estimate, Found))


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Summary of the errors of many searches."""

    count: int
    mean_deg: float
    sd_deg: float | None
    """``mean_deg`` and ``sd_deg``: mean and standard deviation of the absolute error; the latter is None for one
    search."""
    half_deg: float | None
    """Half the width of the 95 % interval of the mean; None for one search."""
    failed: float
    """Share of searches with an error beyond `SENSITIVE_DEG`, whether they claim their angle or not."""
    unclaimed: float
    """Share of searches that claim no angle: not found, at bound, ambiguous or unsure."""
    claimed_failed: float
    """Share of searches that claim an angle with an error beyond `SENSITIVE_DEG`."""

    @property
    def cells(self) -> dict[str, Cell]:
        """The summary as cells of a table."""
        return {
            "searches": self.count,
            "mean_error_deg": self.mean_deg,
            "spread_deg": self.sd_deg,
            "half_interval95_deg": self.half_deg,
            "share_off_by_more_than_4.33_deg": self.failed,
            "share_without_a_claim": self.unclaimed,
            "claimed_and_off_by_more_than_4.33_deg": self.claimed_failed,
        }


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
    moments = Moments.of(errors.tolist())
    interval = moments.interval
    return Errors(
        count=moments.count,
        mean_deg=moments.mean,
        sd_deg=moments.sd,
        half_deg=None if interval is None else (interval[1] - interval[0]) / 2,
        failed=float(np.mean(errors > SENSITIVE_DEG)),
        unclaimed=float(np.mean(~claimed)),
        claimed_failed=float(np.mean(claimed & (errors > SENSITIVE_DEG))),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A number of the paper and ours; or, of the posterior, ours alone."""

    paper: PaperNumber | OwnNumber
    """The paper's; of the posterior what is counted, in words."""
    ours: float
    sd: float | None = None
    half: float | None = None
    """Half the width of the 95 % interval of ours."""
    failed: float | None = None
    """Share of our searches with an error beyond `SENSITIVE_DEG`; None where it is no mean of errors."""
    unclaimed: float | None = None
    """Share of our searches that claim no angle; None where it is no mean of errors."""
    condition: str = ""
    """Condition of ours, such as the noise; empty where there is only one."""

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's; None where the paper has none."""
        return None if self.paper.value is None else self.ours - self.paper.value


def compared(number: str | OwnNumber, ours: Errors, *, condition: str = "") -> Comparison:
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
    alt: str = ""
    """``draw`` and ``alt``: makes the picture, and what it shows, in words; None where there is no picture."""
    remarks: tuple[str, ...] = ()
    """Sentences about the results and their limits."""
