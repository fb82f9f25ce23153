"""What is kept of one policy in one cell while its rows pass by, and what is said of them in the end."""

from __future__ import annotations

import math

import msgspec

from markerseek.studies.policies import PolicySettings
from markerseek.studies.settings import Value
from markerseek.studies.statistics import Mean, Moments, Share
from markerseek.studies.trial import ANSWERS, Row

FAILURE_DEG = 4.33
"""Error beyond which a search failed: the half range within which a tool tip is seen (paper, section 2.5 D)."""

CLAIM_DEG = 1.0
"""Error beyond which a search that says `Found` claimed what is wrong (promise P10)."""


class PolicySummary(msgspec.Struct, frozen=True, kw_only=True):
    """One policy in one cell.

    ``error_deg``, ``failures`` are of the searches that found. The rest is of all with a marker, whatever the answer:
    ``any_error_deg`` with its root mean square ``rmse_deg``, ``off``, ``not_found``, ``missed``, ``wrong_claims``;
    ``covered`` is of those that gave an interval, ``false_found`` of those without a marker. ``marks_deg`` holds the
    mean errors after so many acquisitions as the study's marks say.
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


def failed(row: Row) -> bool:
    """Whether a search found what is not there: too far from the marker, or where there is none."""
    return row.answer == "found" and (row.error_deg is None or not row.error_deg <= FAILURE_DEG)


def found_error(row: Row) -> float | None:
    """Error of a search that found; None for any other."""
    return row.error_deg if row.answer == "found" else None


class Tally:
    """Counts and moments of one policy in one cell.

    Parameters
    ----------
    marks
        Number of the study's marks.
    """

    def __init__(self, marks: int) -> None:
        self._trials = self._failures = self._refused = 0
        self._answers = dict.fromkeys(ANSWERS, 0)
        self._error, self._acquisitions, self._travel, self._elapsed = Moments(), Moments(), Moments(), Moments()
        self._any_error, self._any_square = Moments(), Moments()
        self._marks = [Moments()] * marks
        self._with_marker = self._off = self._found = self._missed = self._wrong = 0
        self._intervals = self._covered = self._without = self._false = 0

    def add(self, rows: list[Row]) -> None:
        """Take in some rows."""
        self._trials += len(rows)
        for row in rows:
            self._answers[row.answer] += 1
            self._failures += failed(row)
            self._refused += row.refused
            self._count(row)
        self._error = self._error.merged(Moments.of([e for row in rows if (e := found_error(row)) is not None]))
        known = [row.error_deg for row in rows if row.error_deg is not None]
        self._any_error = self._any_error.merged(Moments.of(known))
        self._any_square = self._any_square.merged(Moments.of([error**2 for error in known]))
        for mark, moments in enumerate(self._marks):
            here = [
                abs(row.marks_deg[mark] - row.truth_deg) for row in rows if row.truth_deg is not None and row.marks_deg
            ]
            self._marks[mark] = moments.merged(Moments.of(here))
        self._acquisitions = self._acquisitions.merged(
            Moments.of([float(row.acquisitions) for row in rows if row.acquisitions is not None])
        )
        self._travel = self._travel.merged(Moments.of([row.travel_deg for row in rows if row.travel_deg is not None]))
        self._elapsed = self._elapsed.merged(Moments.of([row.elapsed_s for row in rows if row.elapsed_s is not None]))

    def _count(self, row: Row) -> None:
        if row.truth_deg is None:
            self._without += 1
            self._false += row.answer == "found"
            return
        self._with_marker += 1
        error_deg = row.error_deg
        self._off += error_deg is None or not error_deg <= FAILURE_DEG
        self._found += row.answer == "found"
        self._missed += row.answer == "not found"
        self._wrong += row.answer == "found" and (error_deg is None or not error_deg <= CLAIM_DEG)
        if row.low_deg is not None and row.high_deg is not None:
            self._intervals += 1
            self._covered += row.low_deg <= row.truth_deg <= row.high_deg

    def summary(self, *, cell: int, settings: dict[str, Value], policy: int, said: PolicySettings) -> PolicySummary:
        """What all rows so far say.

        Parameters
        ----------
        cell, settings
            Which cell, and its varied settings.
        policy, said
            Which policy, and how it is set.
        """
        there = self._with_marker
        mean_square = self._any_square.mean if self._any_square.count else None
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
            any_error_deg=Mean.of(self._any_error),
            rmse_deg=None if mean_square is None else math.sqrt(mean_square),
            off=Share.of(self._off, there),
            not_found=Share.of(there - self._found, there),
            missed=Share.of(self._missed, there),
            wrong_claims=Share.of(self._wrong, there),
            covered=Share.of(self._covered, self._intervals),
            false_found=Share.of(self._false, self._without),
            marks_deg=[Mean.of(moments) for moments in self._marks],
            answers={answer: Share.of(hits, self._trials) for answer, hits in self._answers.items()},
            acquisitions=Mean.of(self._acquisitions),
            travel_deg=Mean.of(self._travel),
            elapsed_s=Mean.of(self._elapsed),
            refused=self._refused,
        )
