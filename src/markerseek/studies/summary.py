"""Summary of a study's table: errors, failures, answers and cost by policy and cell, and differences of errors.

There are two sets of figures. Of the searches that answer `Found`: error, and failures, which are errors beyond
`FAILURE_DEG` or something found without a marker. Of every search with a marker, whatever its answer: error of
``mean_deg``, shares off by more than `FAILURE_DEG`, not found, missed (the answer "not found"), and found but off by
more than `CLAIM_DEG` (promise P10); and how often a 95 % interval covers the truth (P11). Memory does not grow with the
table.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from itertools import combinations, groupby, islice

import msgspec

from markerseek.studies.policies import PolicySettings
from markerseek.studies.statistics import Mean, Moments
from markerseek.studies.study import Study, cells
from markerseek.studies.tally import FAILURE_DEG, PolicySummary, Tally, found_error
from markerseek.studies.trial import Row

ALL_PAIRS = 6
"""Most policies of which every pair is compared; with more, pairs with the same number of acquisitions."""

_BLOCK = 4096
"""Rows, at least, whose moments are computed together: NumPy is slow on a few values, and memory must not grow."""


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

    Parameters
    ----------
    study
        The study.
    rows
        In the order of the table: a trial's policies one after another.
    """
    pairs = compared(study.policies)
    policies: list[PolicySummary] = []
    differences: list[Difference] = []
    # Whole trials, so that all policies of a trial are in one block.
    block_rows = -(-_BLOCK // len(study.policies)) * len(study.policies)
    count = 0
    # The table is in the order of the cells, so that a cell is finished before the next begins.
    for index, of_cell in groupby(rows, key=lambda row: row.cell):
        tallies = [Tally(len(study.marks)) for _ in study.policies]
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
        settings = dict(cells(study)[index].varied)
        policies += [
            tally.summary(cell=index, settings=settings, policy=policy, policy_settings=study.policies[policy])
            for policy, tally in enumerate(tallies)
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
    errors = ((found_error(row), found_error(beside)) for row, beside in zip(one, other, strict=True))
    return [a - b for a, b in errors if a is not None and b is not None]
