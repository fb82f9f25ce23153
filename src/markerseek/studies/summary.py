"""What a study's table says: per cell and policy errors, failures, answers, cost; and policies against one another.

An error counts where a search says `Found` and the truth is known. It fails where that error exceeds `FAILURE_DEG`, or
where it found something and there is no marker; failure rates are shares of the searches that found. A method that
says "not found" is therefore judged by its answers' shares as well. Memory does not grow with the table.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations, groupby

import msgspec

from markerseek.studies.statistics import Mean, Moments, Share
from markerseek.studies.study import PolicySettings, Study, Value, cells
from markerseek.studies.trial import ANSWERS, Row

FAILURE_DEG = 4.33
"""Error beyond which a search failed: the half range within which a tool tip is seen (paper, section 2.5 D)."""

ALL_PAIRS = 6
"""Most policies of which every pair is compared; of more, those with the same number of acquisitions."""

_BLOCK = 4096
"""Trials that are gathered before they are merged."""


class PolicySummary(msgspec.Struct, frozen=True, kw_only=True):
    """One policy in one cell: of `trials` searches, the answers' shares; of those found, errors and failures."""

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
    answers: dict[str, Share]
    acquisitions: Mean
    travel_deg: Mean
    elapsed_s: Mean
    refused: int


class Difference(msgspec.Struct, frozen=True, kw_only=True):
    """Error of one policy less that of another, over the trials of a cell in which both found."""

    cell: int
    policy: int
    other: int
    labels: tuple[str, str]
    error_deg: Mean


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that a study's table says."""

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
        Whose they are.
    rows
        In the order of the table: a trial's policies one after another.
    """
    pairs = compared(study.policies)
    policies: list[PolicySummary] = []
    differences: list[Difference] = []
    count = 0
    for index, of_cell in groupby(rows, key=lambda row: row.cell):
        tallies = [_Tally() for _ in study.policies]
        apart = [Moments() for _ in pairs]
        for block in _blocks(of_cell, len(study.policies)):
            for policy, tally in enumerate(tallies):
                tally.add([trial[policy] for trial in block])
            apart = [
                moments.merged(Moments.of(_apart(block, one, other)))
                for moments, (one, other) in zip(apart, pairs, strict=True)
            ]
            count += len(block) * len(study.policies)
        settings = dict(cells(study)[index].varied)
        policies += [
            tally.summary(cell=index, settings=settings, policy=policy, said=study.policies[policy])
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


def failed(row: Row) -> bool:
    """Whether a search found what is not there: too far from the marker, or where there is none."""
    return row.answer == "found" and (row.error_deg is None or not row.error_deg <= FAILURE_DEG)


class _Tally:
    """What is kept of one policy in one cell."""

    def __init__(self) -> None:
        self._trials = self._failures = self._refused = 0
        self._answers = dict.fromkeys(ANSWERS, 0)
        self._error, self._acquisitions, self._travel, self._elapsed = Moments(), Moments(), Moments(), Moments()

    def add(self, rows: list[Row]) -> None:
        self._trials += len(rows)
        for row in rows:
            self._answers[row.answer] += 1
            self._failures += failed(row)
            self._refused += row.refused
        self._error = self._error.merged(Moments.of([e for row in rows if (e := _error(row)) is not None]))
        self._acquisitions = self._acquisitions.merged(
            Moments.of([float(row.acquisitions) for row in rows if row.acquisitions is not None])
        )
        self._travel = self._travel.merged(Moments.of([row.travel_deg for row in rows if row.travel_deg is not None]))
        self._elapsed = self._elapsed.merged(Moments.of([row.elapsed_s for row in rows if row.elapsed_s is not None]))

    def summary(self, *, cell: int, settings: dict[str, Value], policy: int, said: PolicySettings) -> PolicySummary:
        return PolicySummary(
            cell=cell,
            settings=settings,
            policy=policy,
            label=str(said),
            method=said.method,
            acquisitions_most=said.most,
            as_published=said.as_published,
            early_end=said.early_end,
            trials=self._trials,
            error_deg=Mean.of(self._error),
            failures=Share.of(self._failures, self._answers["found"]),
            answers={answer: Share.of(hits, self._trials) for answer, hits in self._answers.items()},
            acquisitions=Mean.of(self._acquisitions),
            travel_deg=Mean.of(self._travel),
            elapsed_s=Mean.of(self._elapsed),
            refused=self._refused,
        )


def _error(row: Row) -> float | None:
    """Error of a search that found; None for any other."""
    return row.error_deg if row.answer == "found" else None


def _apart(block: list[list[Row]], one: int, other: int) -> list[float]:
    """Differences of the errors of two policies, trial by trial."""
    errors = ((_error(trial[one]), _error(trial[other])) for trial in block)
    return [a - b for a, b in errors if a is not None and b is not None]


def _blocks(rows: Iterator[Row], policies: int) -> Iterator[list[list[Row]]]:
    """Trials, each a list of its rows, some thousand at a time."""
    block: list[list[Row]] = []
    for _, trial in groupby(rows, key=lambda row: row.trial):
        block.append(list(trial))
        if len(block) * policies >= _BLOCK:
            yield block
            block = []
    if block:
        yield block
