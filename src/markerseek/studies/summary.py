"""Summary of a study's table: errors, failures, answers and cost by policy and cell, and differences of errors.

There are two sets of figures. Of the searches that answer `Found`: error, and failures, which are errors beyond
`FAILURE_DEG` or something found without a marker. Of every search with a marker, whatever its answer: error of
``mean_deg``, shares off by more than `FAILURE_DEG`, not found, missed (the answer "not found"), and found but off by
more than `CLAIM_TOLERANCES` times the tolerance (promise P10); and how often a 95 % interval covers the truth (P11).
Counts and moments are added up row by row: memory does not grow with the table.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from itertools import combinations, groupby, islice

import msgspec

from markerseek.studies.policies import PolicySettings
from markerseek.studies.settings import Value
from markerseek.studies.statistics import Mean, Moments, Share
from markerseek.studies.study import Cell, Study, cells
from markerseek.studies.trial import ANSWERS, Row

FAILURE_DEG = 4.33
"""Error beyond which a search failed: the half range within which a tool tip is seen (paper, section 2.5 D)."""

CLAIM_TOLERANCES = 2.0
"""Error over the tolerance beyond which the claim of a `Found` is wrong (promise P10)."""

ALL_PAIRS = 6
"""Most policies of which every pair is compared; with more, pairs with the same number of acquisitions."""

_BLOCK = 4096
"""Rows, at least, whose moments are computed together: NumPy is slow on a few values, and memory must not grow."""


class TwoSources(msgspec.Struct, frozen=True, kw_only=True):
    """Answers where the scene holds a second source, as shares of all its searches.

    ``stronger`` is `Found` at the stronger source, or ambiguous; ``weaker`` and ``between`` are `Found` at the weaker
    one, and at neither but between them; ``named``: the answer, whatever it is, names the other source too.
    """

    stronger: Share
    weaker: Share
    between: Share
    named: Share


class PolicySummary(msgspec.Struct, frozen=True, kw_only=True):
    """One policy in one cell.

    ``error_deg``, ``failures`` are of the searches that found. The rest is of all with a marker, whatever the answer:
    ``any_error_deg`` with its root mean square ``rmse_deg``, ``off``, ``not_found``, ``missed``, ``wrong_claims``;
    ``covered`` is of those that gave an interval, ``false_found`` of those without a marker. ``marks_deg`` holds the
    mean errors at the study's marks (numbers of acquisitions). ``two_sources`` is None where there was one source.
    """

    cell: int
    settings: dict[str, Value]
    policy: int
    label: str
    method: str
    acquisitions_most: int
    as_published: bool
    early_end: bool
    trials: int
    error_deg: Mean
    failures: Share
    any_error_deg: Mean
    rmse_deg: float | None
    off: Share
    not_found: Share
    missed: Share
    wrong_claims: Share
    covered: Share
    false_found: Share
    marks_deg: list[Mean]
    answers: dict[str, Share]
    acquisitions: Mean
    travel_deg: Mean
    elapsed_s: Mean
    refused: int
    two_sources: TwoSources | None = None


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Error of one policy minus that of another, over the trials of a cell in which both found."""

    cell: int
    policy: int
    other: int
    labels: tuple[str, str]
    error_deg: Mean


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Summary of a study's table."""

    study: str
    name: str
    level: str
    rows: int
    failure_deg: float
    policies: list[PolicySummary]
    differences: list[Difference]


def summarise(study: Study, rows: Iterable[Row]) -> Summary:
    """Summary of a study's rows.

    ``rows``: in the order of the table: a trial's policies one after another.
    """
    pairs = compared(study.policies)
    policies: list[PolicySummary] = []
    differences: list[Difference] = []
    # Whole trials, so that all policies of a trial are in one block.
    block_rows = -(-_BLOCK // len(study.policies)) * len(study.policies)
    count = 0
    # The table is in the order of the cells, so that a cell is finished before the next begins.
    for index, of_cell in groupby(rows, key=lambda row: row.cell):
        tallies = [_Tally(len(study.marks)) for _ in study.policies]
        apart = [Moments() for _ in pairs]
        while block := list(islice(of_cell, block_rows)):
            by_policy: defaultdict[int, list[Row]] = defaultdict(list)
            for row in block:
                by_policy[row.policy].append(row)
            for policy, tally in enumerate(tallies):
                tally.add(by_policy[policy])
            # Of the same trials: their common noise cancels, and the interval is narrower than that of two means.
            apart = [
                moments.merged(Moments.of(_apart(by_policy[one], by_policy[other])))
                for moments, (one, other) in zip(apart, pairs, strict=True)
            ]
            count += len(block)
        policies += [
            tally.summary(cells(study)[index], policy, study.policies[policy]) for policy, tally in enumerate(tallies)
        ]
        differences += [
            Difference(
                cell=index,
                policy=one,
                other=other,
                labels=(str(study.policies[one]), str(study.policies[other])),
                error_deg=Mean.of(moments),
            )
            for moments, (one, other) in zip(apart, pairs, strict=True)
        ]
    return Summary(
        study=study.digest,
        name=study.name,
        level=study.level,
        rows=count,
        failure_deg=FAILURE_DEG,
        policies=policies,
        differences=differences,
    )


def compared(policies: tuple[PolicySettings, ...]) -> list[tuple[int, int]]:
    """Pairs of policies that are compared, by their numbers; see `ALL_PAIRS`."""
    pairs = combinations(range(len(policies)), 2)
    if len(policies) <= ALL_PAIRS:
        return list(pairs)
    return [(one, other) for one, other in pairs if policies[one].most == policies[other].most]


def _apart(one: list[Row], other: list[Row]) -> list[float]:
    """Differences of the errors of two policies, trial by trial."""
    errors = ((_found_error(row), _found_error(beside)) for row, beside in zip(one, other, strict=True))
    return [a - b for a, b in errors if a is not None and b is not None]


class _Tally:
    """Counts and moments of one policy in one cell, added up row by row."""

    def __init__(self, marks: int) -> None:
        self._marks = range(marks)
        self._counts: Counter[str] = Counter()
        self._answers = dict.fromkeys(ANSWERS, 0)
        self._moments: defaultdict[str | int, Moments] = defaultdict(Moments)

    def add(self, rows: list[Row]) -> None:
        """Add some rows."""
        errors = [row.error_deg for row in rows if row.error_deg is not None]
        values: dict[str | int, list[float]] = {
            "found error": [error for row in rows if (error := _found_error(row)) is not None],
            "error": errors,
            "square": [error**2 for error in errors],
            "acquisitions": [float(row.acquisitions) for row in rows if row.acquisitions is not None],
            "travel": [row.travel_deg for row in rows if row.travel_deg is not None],
            "elapsed": [row.elapsed_s for row in rows if row.elapsed_s is not None],
        }
        for mark in self._marks:
            # A search that a device ended has no answers at the marks.
            values[mark] = [
                abs(row.marks_deg[mark] - row.truth_deg) for row in rows if row.truth_deg is not None and row.marks_deg
            ]
        for name, numbers in values.items():
            self._moments[name] = self._moments[name].merged(Moments.of(numbers))
        for row in rows:
            self._answers[row.answer] += 1
            self._counts.update(trials=1, failed=_failed(row), refused=row.refused)
            self._count(row)

    def _count(self, row: Row) -> None:
        found = row.answer == "found"
        if row.truth_deg is None:
            self._counts.update(no_marker=1, false_found=found)
            return
        if row.second_deg is not None:
            stronger = row.answer == "ambiguous" or (found and row.nearest == "stronger")
            self._counts.update(two=1, stronger=stronger, named=row.other_deg is not None)
            self._counts.update({f"found {row.nearest}": found})
        # A search that a device ended has no error: it is off, and nothing was claimed.
        error_deg = math.inf if row.error_deg is None else row.error_deg
        self._counts.update(
            marker=1,
            off=not error_deg <= FAILURE_DEG,
            not_found=not found,
            missed=row.answer == "not found",
            wrong=found and not error_deg <= CLAIM_TOLERANCES * row.tolerance_deg,
        )
        if row.low_deg is not None and row.high_deg is not None:
            self._counts.update(intervals=1, covered=row.low_deg <= row.truth_deg <= row.high_deg)

    def summary(self, cell: Cell, policy: int, settings: PolicySettings) -> PolicySummary:
        """Return the summary of all rows so far."""
        counts = self._counts

        def mean(name: str | int) -> Mean:
            return Mean.of(self._moments[name])

        mean_square = mean("square").mean
        return PolicySummary(
            cell=cell.index,
            settings=dict(cell.varied),
            policy=policy,
            label=str(settings),
            method=settings.method,
            acquisitions_most=settings.most,
            as_published=settings.as_published,
            early_end=settings.early_end,
            trials=counts["trials"],
            error_deg=mean("found error"),
            failures=Share.of(counts["failed"], self._answers["found"]),
            any_error_deg=mean("error"),
            rmse_deg=None if mean_square is None else math.sqrt(mean_square),
            off=Share.of(counts["off"], counts["marker"]),
            not_found=Share.of(counts["not_found"], counts["marker"]),
            missed=Share.of(counts["missed"], counts["marker"]),
            wrong_claims=Share.of(counts["wrong"], counts["marker"]),
            covered=Share.of(counts["covered"], counts["intervals"]),
            false_found=Share.of(counts["false_found"], counts["no_marker"]),
            marks_deg=[mean(mark) for mark in self._marks],
            answers={answer: Share.of(hits, counts["trials"]) for answer, hits in self._answers.items()},
            acquisitions=mean("acquisitions"),
            travel_deg=mean("travel"),
            elapsed_s=mean("elapsed"),
            refused=counts["refused"],
            two_sources=None
            if counts["two"] == 0
            else TwoSources(
                stronger=Share.of(counts["stronger"], counts["two"]),
                weaker=Share.of(counts["found weaker"], counts["two"]),
                between=Share.of(counts["found between"], counts["two"]),
                named=Share.of(counts["named"], counts["two"]),
            ),
        )


def _failed(row: Row) -> bool:
    """Whether a search found something wrong: too far from the marker, or without a marker."""
    # Not ">": an error of NaN must count as a failure.
    return row.answer == "found" and (row.error_deg is None or not row.error_deg <= FAILURE_DEG)


def _found_error(row: Row) -> float | None:
    """Error of a search that found; None for any other."""
    return row.error_deg if row.answer == "found" else None
