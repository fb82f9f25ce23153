"""Summary of a study's table: errors, failures, answers and cost by policy and cell, and differences of errors.

There are two sets of figures. Of the searches that answer `Found`: error, and failures, which are errors beyond
`FAILURE_DEG` or something found without a marker. Of every search with a marker, whatever its answer: error of
``mean_deg``, shares off by more than `FAILURE_DEG`, not found, missed (the answer "not found"), and found but off by
more than `CLAIM_TOLERANCES` times the tolerance (promise P10); and how often a 95 % interval covers the truth (P11).
The table is in the order of the cells, and only one cell is in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, groupby
from typing import get_args

import msgspec

from markerseek.studies.policies import StudyPolicy
from markerseek.studies.statistics import Mean, Share, root_mean_square
from markerseek.studies.study import Cell, Study, Value, cells
from markerseek.studies.trial import Answer, Row

FAILURE_DEG = 4.33
"""Error beyond which a search failed: the half range within which a tool tip is seen (paper, section 2.5 D)."""

CLAIM_TOLERANCES = 2.0
"""Error over the tolerance beyond which the claim of a `Found` is wrong (promise P10)."""

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
    failures: Share
    """Errors beyond `FAILURE_DEG`, or something found without a marker, of the searches that found."""
    any_error_deg: Mean
    """Error of all searches with a marker, whatever the answer."""
    rmse_deg: float | None
    """Root mean square of the same errors."""
    off: Share
    """Errors beyond `FAILURE_DEG`, of all searches with a marker."""
    not_found: Share
    """Any answer but found, of all searches with a marker."""
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
    refused: int
    """Frames that were refused."""
    two_sources: TwoSources | None = None
    """None if there was one source."""


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
                labels=(str(study.policies[one]), str(study.policies[other])),
                # Of the same trials: their common noise cancels, and the interval is narrower than that of two means.
                error_deg=Mean.of(_apart(by_policy[one], by_policy[other])),
            )
            for one, other in compared(study.policies)
        ]
    return Summary(
        study=study.digest,
        name=study.name,
        level=study.level,
        rows=sum(policy.trials for policy in policies),
        failure_deg=FAILURE_DEG,
        policies=policies,
        differences=differences,
    )


def compared(policies: tuple[StudyPolicy, ...]) -> list[tuple[int, int]]:
    """Pairs of policies that are compared, by their numbers; see `ALL_PAIRS`."""
    pairs = combinations(range(len(policies)), 2)
    if len(policies) <= ALL_PAIRS:
        return list(pairs)
    return [(one, other) for one, other in pairs if policies[one].most == policies[other].most]


def _apart(one: list[Row], other: list[Row]) -> list[float]:
    """Differences of the errors of two policies, trial by trial."""
    errors = ((_found_error(row), _found_error(beside)) for row, beside in zip(one, other, strict=True))
    return [a - b for a, b in errors if a is not None and b is not None]


def _summary(cell: Cell, number: int, policy: StudyPolicy, rows: Sequence[Row], *, marks: int) -> PolicySummary:
    """Summary of one policy in one cell."""
    marked = [row for row in rows if row.truth_deg is not None]
    errors_deg = _known(row.error_deg for row in rows)
    return PolicySummary(
        cell=cell.index,
        settings=dict(cell.varied),
        policy=number,
        label=str(policy),
        trials=len(rows),
        error_deg=Mean.of(_known(_found_error(row) for row in rows)),
        failures=_share((row for row in rows if row.answer == "found"), _failed),
        any_error_deg=Mean.of(errors_deg),
        rmse_deg=root_mean_square(errors_deg) if errors_deg else None,
        # A search that a device ended has no error: it is off, and nothing was claimed.
        off=_share(marked, lambda row: _is_off(row, FAILURE_DEG)),
        not_found=_share(marked, lambda row: row.answer != "found"),
        missed=_share(marked, lambda row: row.answer == "not found"),
        wrong_claims=_share(
            marked, lambda row: row.answer == "found" and _is_off(row, CLAIM_TOLERANCES * row.tolerance_deg)
        ),
        covered=_share((row for row in marked if row.low_deg is not None), covers),
        false_found=_share((row for row in rows if row.truth_deg is None), lambda row: row.answer == "found"),
        # A search that a device ended has no answers at the marks.
        marks_deg=[
            Mean.of([abs(row.marks_deg[mark] - (row.truth_deg or 0.0)) for row in marked if row.marks_deg])
            for mark in range(marks)
        ],
        answers={answer: _share(rows, lambda row, answer=answer: row.answer == answer) for answer in get_args(Answer)},  # type: ignore[misc]
        acquisitions=Mean.of(_known(row.acquisitions for row in rows)),
        travel_deg=Mean.of(_known(row.travel_deg for row in rows)),
        elapsed_s=Mean.of(_known(row.elapsed_s for row in rows)),
        known_s=Mean.of(_known(row.known_s for row in rows)),
        refused=sum(row.refused for row in rows),
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
    """Share of the rows for which something holds."""
    hits = [holds(row) for row in rows]
    return Share.of(sum(hits), len(hits))


def _known(values: Iterable[float | None]) -> list[float]:
    """The values that are known."""
    return [value for value in values if value is not None]


def _is_off(row: Row, limit_deg: float) -> bool:
    """Whether the error is beyond a limit, or unknown."""
    # Not ">": an error of NaN must count as a failure.
    return row.error_deg is None or not row.error_deg <= limit_deg


def covers(row: Row) -> bool:
    """Whether the 95 % interval holds the truth."""
    low_deg, truth_deg, high_deg = row.low_deg, row.truth_deg, row.high_deg
    return low_deg is not None and truth_deg is not None and high_deg is not None and low_deg <= truth_deg <= high_deg


def _failed(row: Row) -> bool:
    """Whether a search found something wrong: too far from the marker, or without a marker."""
    return row.answer == "found" and _is_off(row, FAILURE_DEG)


def _found_error(row: Row) -> float | None:
    """Error of a search that found; None for any other."""
    return row.error_deg if row.answer == "found" else None
