"""What the reproduction of one figure or table consists of: text, tables, comparisons with the paper, a picture.

The text is in `prose.md`, where a section has its name and title as a heading, then paragraphs, the words for its
picture as an image, and remarks. Results stand in it as fields of `str.format`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from markerseek.core import ConfigError, Estimate, Found
from markerseek.studies.paper.printed import SENSITIVE_DEG, OwnNumber, PaperNumber, paper_number
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
    def cells(self) -> tuple[Cell, ...]:
        """The summary as cells of a table, under `ERRORS`."""
        return astuple(self)


ERRORS = (
    "searches mean_error_deg spread_deg half_interval95_deg share_off_by_more_than_4.33_deg share_without_a_claim "
    "claimed_and_off_by_more_than_4.33_deg"
)
"""Columns of `Errors.cells`."""


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
        count=mean.count,
        mean_deg=float(np.mean(errors)),
        sd_deg=mean.sd,
        half_deg=mean.half,
        failed=float(np.mean(errors > SENSITIVE_DEG)),
        unclaimed=float(np.mean(~claimed)),
        claimed_failed=float(np.mean(claimed & (errors > SENSITIVE_DEG))),
    )


def errors_table(name: str, caption: str, columns: str, errors: Mapping[tuple[Any, ...], Errors]) -> Table:
    """Table of the errors of groups of searches, whose names go into the first columns."""
    rows = ((*group, *each.cells) for group, each in errors.items())
    return make_table(name, caption, f"{columns} {ERRORS}", rows, shown=False)


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


def make_section(
    name: str,
    *,
    method: tuple[str, ...] = (),
    comparisons: tuple[Comparison, ...] = (),
    tables: tuple[Table, ...] = (),
    draw: Callable[[], Figure] | None = None,
    remarks: tuple[str, ...] = (),
    **results: object,
) -> Section:
    """Return a section with its text.

    ``method``: headings whose paragraphs come first. ``remarks``: sentences before those of the text. ``results``: what
    stands in the text.
    """
    text = _prose()[name]
    paragraphs = (paragraph for heading in (*method, name) for paragraph in _prose()[heading].paragraphs)
    return Section(
        name=name,
        title=text.title.format(**results),
        method=tuple(paragraph.format(**results) for paragraph in paragraphs),
        comparisons=comparisons,
        tables=tables,
        draw=draw,
        alt=text.alt,
        remarks=(*remarks, *(remark.format(**results) for remark in text.remarks)),
    )


class _Text(NamedTuple):
    title: str
    paragraphs: tuple[str, ...]
    alt: str
    remarks: tuple[str, ...]


@cache
def _prose() -> dict[str, _Text]:
    """The text of each section by its name."""
    text = resources.files(__package__).joinpath("prose.md").read_text(encoding="utf-8")
    found = {}
    for part in re.split(r"^# ", text, flags=re.MULTILINE)[1:]:
        heading, _, rest = part.partition("\n")
        name, _, title = heading.partition(": ")
        method, _, remarks = rest.partition("## Remarks")
        picture = re.search(r"!\[(.*?)\]", method, flags=re.DOTALL)
        found[name] = _Text(
            title=title,
            paragraphs=_paragraphs(re.sub(r"!\[.*?\]\(.*?\)", "", method, flags=re.DOTALL)),
            alt="" if picture is None else " ".join(picture[1].split()),
            remarks=_paragraphs(remarks),
        )
    return found


def _paragraphs(text: str) -> tuple[str, ...]:
    return tuple(" ".join(paragraph.split()) for paragraph in text.split("\n\n") if paragraph.strip())
