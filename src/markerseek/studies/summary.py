"""Summary of a study's table: errors, answers and cost by policy and cell, and differences of errors.

Errors are those of the searches that answer `Found`, and those of every search with a marker, whatever its answer. A
claim is wrong if the answer is `Found` and off by more than `CLAIM_TOLERANCES` times the tolerance; an
interval of 95 % covers the truth or does not. The table is in the order of the cells, and only one cell is in
memory.

The 95 % intervals are Student's t for a mean, and those of Clopper and Pearson (1934) for a share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, groupby
from typing import get_args

import msgspec
import numpy as np
from scipy.special import betaincinv, stdtrit

from markerseek.studies.policies import StudyPolicy
from markerseek.studies.study import Cell, Study, Value, cells
from markerseek.studies.trial import Row, TrialAnswer

CONFIDENCE = 0.95
"""Probability that an interval covers the true value."""


class Mean(msgspec.Struct, frozen=True, kw_only=True):
    """A mean with its 95 % interval, and the standard deviation of one value; None if there are too few."""

    count: int
    mean: float | None
    interval95: tuple[float, float] | None
    sd: float | None

    @classmethod
    def of(cls, values: Sequence[float]) -> Mean:
        """Return the mean of a sample."""
        count = len(values)
        mean = float(np.mean(values)) if count else None
        if mean is None or count < 2:
            return cls(count=count, mean=mean, interval95=None, sd=None)
        sd = float(np.std(values, ddof=1))
        # The quantile itself: `scipy.stats.t` gives the same and takes 0.4 s to import.
        half = float(stdtrit(count - 1, (1 + CONFIDENCE) / 2)) * sd / math.sqrt(count)
        return cls(count=count, mean=mean, interval95=(mean - half, mean + half), sd=sd)

    @property
    def half(self) -> float | None:
        """Half the width of the interval; None for fewer than two values."""
        return None if self.interval95 is None else (self.interval95[1] - self.interval95[0]) / 2


class Share(msgspec.Struct, frozen=True, kw_only=True):
    """Hits over trials, with the 95 % interval of the probability; None without trials."""

    hits: int
    count: int
    share: float | None
    interval95: tuple[float, float] | None

    @classmethod
    def of(cls, hits: int, count: int) -> Share:
        """Return the share of hits."""
        if count == 0:
            return cls(hits=0, count=0, share=None, interval95=None)
        return cls(hits=hits, count=count, share=hits / count, interval95=clopper_pearson(hits, count))


def clopper_pearson(hits: int, count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of the probability of a hit."""
    # The quantiles of the beta distribution themselves. `scipy.stats.binomtest` searches for the same limits with an
    # absolute tolerance of 2e-12, and importing it takes 0.4 s, in each worker of a study.
    tail = (1 - CONFIDENCE) / 2
    # The beta distribution has no parameter 0: without hits, or with hits only, the limit is 0 or 1 itself.
    low = 0.0 if hits == 0 else float(betaincinv(hits, count - hits + 1, tail))
    high = 1.0 if hits == count else float(betaincinv(hits + 1, count - hits, 1 - tail))
    return low, high


CLAIM_TOLERANCES = 2.0
"""Error over the tolerance beyond which the claim of a `Found` is wrong."""

ALL_PAIRS = 6
"""Most policies for which every pair is compared; with more, pairs with the same number of acquisitions."""


class TwoSources(msgspec.Struct, frozen=True, kw_only=True):
    """Answers where the scene holds a second source, as shares of all searches there."""

    stronger: Share
    """`Found` at the stronger source, or ambiguous."""
    weaker: Share
    """`Found` at the weaker source."""
    between: Share
    """`Found` at neither, but between them."""
    named: Share
    """The answer, whatever it is, names the other source too."""


class PolicySummary(msgspec.Struct, frozen=True, kw_only=True):
    """One policy in one cell."""

    cell: int
    settings: dict[str, Value]
    """Varied settings of the cell."""
    policy: int
    """Number of the policy in the study, from 0."""
    label: str
    trials: int
    error_deg: Mean
    """Error of the searches that found."""
    any_error_deg: Mean
    """Error of all searches with a marker, whatever the answer."""
    missed: Share
    """The answer "not found", of all searches with a marker."""
    wrong_claims: Share
    """Found and off by more than `CLAIM_TOLERANCES`, of all searches with a marker."""
    covered: Share
    """95 % intervals that hold the truth, of all searches with a marker that gave an interval."""
    false_found: Share
    """Found, of all searches without a marker."""
    marks_deg: list[Mean]
    """Mean errors at the marks of the study."""
    answers: dict[str, Share]
    """Shares of all answers."""
    acquisitions: Mean
    travel_deg: Mean
    elapsed_s: Mean
    known_s: Mean
    """Time to the answer of the searches that found."""
    two_sources: TwoSources | None = None
    """None if there was one source."""


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Error of one policy minus that of another, over the trials of a cell in which both found."""

    cell: int
    policy: int
    other: int
    error_deg: Mean


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Summary of a study's table."""

    study: str
    name: str
    level: str
    rows: int
    policies: list[PolicySummary]
    differences: list[Difference]


def summarise(study: Study, rows: Iterable[Row]) -> Summary:
    """Return the summary of a study's rows.

    ``rows``: in the order of the table: a trial's policies one after another.
    """
    policies: list[PolicySummary] = []
    differences: list[Difference] = []
    for index, of_cell in groupby(rows, key=lambda row: row.cell):
        by_policy: list[list[Row]] = [[] for _ in study.policies]
        for row in of_cell:
            by_policy[row.policy].append(row)
        policies += [
            _summary(cells(study)[index], number, settings, by_policy[number], marks=len(study.marks))
            for number, settings in enumerate(study.policies)
        ]
        differences += [
            Difference(
                cell=index,
                policy=one,
                other=other,
                # Of the same trials: their common noise cancels, and the interval is narrower than that of two means.
                error_deg=Mean.of(_apart(by_policy[one], by_policy[other])),
            )
            for one, other in compared_pairs(study.policies)
        ]
    return Summary(
        study=study.digest,
        name=study.name,
        level=study.level,
        rows=sum(policy.trials for policy in policies),
        policies=policies,
        differences=differences,
    )


def compared_pairs(policies: tuple[StudyPolicy, ...]) -> list[tuple[int, int]]:
    """Return the pairs of policies that are compared, by their numbers; see `ALL_PAIRS`."""
    pairs = combinations(range(len(policies)), 2)
    if len(policies) <= ALL_PAIRS:
        return list(pairs)
    return [(one, other) for one, other in pairs if policies[one].most == policies[other].most]


def _apart(one: list[Row], other: list[Row]) -> list[float]:
    """Return the differences of the errors of two policies, trial by trial."""
    errors = ((_found_error(row), _found_error(beside)) for row, beside in zip(one, other, strict=True))
    return [a - b for a, b in errors if a is not None and b is not None]


def _summary(cell: Cell, number: int, policy: StudyPolicy, rows: Sequence[Row], *, marks: int) -> PolicySummary:
    """Return the summary of one policy in one cell."""
    marked = [row for row in rows if row.truth_deg is not None]
    return PolicySummary(
        cell=cell.index,
        settings=dict(cell.varied),
        policy=number,
        label=str(policy),
        trials=len(rows),
        error_deg=Mean.of(_known(_found_error(row) for row in rows)),
        any_error_deg=Mean.of(_known(row.error_deg for row in rows)),
        missed=_share(marked, lambda row: row.answer == "not found"),
        wrong_claims=_share(marked, _is_wrong_claim),
        covered=_share((row for row in marked if row.low_deg is not None), _covers),
        false_found=_share((row for row in rows if row.truth_deg is None), lambda row: row.answer == "found"),
        # A search that a device ended has no answers at the marks.
        marks_deg=[
            Mean.of([abs(row.marks_deg[mark] - (row.truth_deg or 0.0)) for row in marked if row.marks_deg])
            for mark in range(marks)
        ],
        answers={name: Share.of(sum(row.answer == name for row in rows), len(rows)) for name in get_args(TrialAnswer)},
        acquisitions=Mean.of(_known(row.acquisitions for row in rows)),
        travel_deg=Mean.of(_known(row.travel_deg for row in rows)),
        elapsed_s=Mean.of(_known(row.elapsed_s for row in rows)),
        known_s=Mean.of(_known(row.known_s for row in rows)),
        two_sources=_two_sources([row for row in marked if row.second_deg is not None]),
    )


def _two_sources(rows: Sequence[Row]) -> TwoSources | None:
    def found_at(row: Row, source: str) -> bool:
        return row.answer == "found" and row.nearest == source

    if not rows:
        return None
    return TwoSources(
        stronger=_share(rows, lambda row: row.answer == "ambiguous" or found_at(row, "stronger")),
        weaker=_share(rows, lambda row: found_at(row, "weaker")),
        between=_share(rows, lambda row: found_at(row, "between")),
        named=_share(rows, lambda row: row.other_deg is not None),
    )


def _share(rows: Iterable[Row], holds: Callable[[Row], bool]) -> Share:
    """Return the share of the rows for which something holds."""
    hits = [holds(row) for row in rows]
    return Share.of(sum(hits), len(hits))


def _known(values: Iterable[float | None]) -> list[float]:
    """Return the values that are known."""
    return [value for value in values if value is not None]


def _is_wrong_claim(row: Row) -> bool:
    """Return whether a search found, and its error is beyond the tolerances of a claim, or unknown."""
    # Not ">": an error of NaN must count as a failure.
    within = row.error_deg is not None and row.error_deg <= CLAIM_TOLERANCES * row.tolerance_deg
    return row.answer == "found" and not within


def _covers(row: Row) -> bool:
    """Return whether the 95 % interval holds the truth."""
    low_deg = row.low_deg
    truth_deg = row.truth_deg
    high_deg = row.high_deg
    return low_deg is not None and truth_deg is not None and high_deg is not None and low_deg <= truth_deg <= high_deg


def _found_error(row: Row) -> float | None:
    """Return the error of a search that found; None for any other."""
    return row.error_deg if row.answer == "found" else None
