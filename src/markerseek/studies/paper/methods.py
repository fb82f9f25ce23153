"""The paper's three methods as published, their searches, and what a reproduction may use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias

from markerseek.core import PAPER_RANGE, ConfigError, Estimate, Interval, Policy, Sample, SearchPlan
from markerseek.rigs import Rig
from markerseek.search import build
from markerseek.sim import StageMotion
from markerseek.studies.trial import searched
from markerseek.studies.workers import DoneT, Job, in_order

PaperMethod: TypeAlias = Literal["TS", "GSS", "WA"]
"""Ternary search, golden-section search, weighted average."""

BUILT: dict[PaperMethod, str] = {"TS": "ternary", "GSS": "golden-section", "WA": "weighted-average"}
"""Names in `markerseek.search`."""

BRACKETS: tuple[PaperMethod, ...] = ("TS", "GSS")

BRACKET_ACQUISITIONS = tuple(range(2, 29, 2))
"""N of TS and GSS in Fig. 5 to 7."""

AVERAGE_ACQUISITIONS = tuple(range(8, 29))
"""N of WA in Fig. 5 and 6: full scans."""

RUNS: tuple[tuple[PaperMethod, tuple[int, ...]], ...] = (
    *((name, BRACKET_ACQUISITIONS) for name in BRACKETS),
    *(("WA", (count,)) for count in AVERAGE_ACQUISITIONS),
)
"""Searches of Fig. 5 and 6, with the numbers of acquisitions after which each is asked for its answer.

The angles of TS and GSS do not depend on N; the steps of WA do, so that each N is its own search.
"""

TABLE_ACQUISITIONS = 16
"""N of Table 1 and Table 2."""

ONLINE_STEPS = 15
"""Acquisitions of WA over the whole range in 5° steps (section 3.3)."""

PAPER_MARKERS = 1000
"""Random markers of the paper's simulation (section 2.4)."""

PEAK_COUNTS = 1500.0
"""Height of the marker's signal in a channel, in counts of a full scale of 2047: high enough that the noise at 60 dB is
larger than the steps of the converter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """What a reproduction may use."""

    seed: int = 1
    markers: int = PAPER_MARKERS
    """Markers of the Monte Carlo studies. Fewer than the paper's 1000 also reduce repeats and frames in proportion."""
    workers: int = 1
    progress: Callable[[str, int, int], None] = lambda _stage, _done, _total: None
    """Receives the name of a stage, how many of its parts are done, and how many there are."""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or more")
        if not 10 <= self.markers <= 1_000_000:
            raise ConfigError(f"markers is {self.markers}, it must lie between 10 and 1000000; the paper has 1000")

    @property
    def share(self) -> float:
        """Markers over the paper's number of them, at most 1."""
        return min(1.0, self.markers / PAPER_MARKERS)

    def each(self, function: Callable[[Job], DoneT], jobs: Sequence[Job], *, stage: str, part: int = 1) -> list[DoneT]:
        """Return the results of a function on many jobs, in their order, whatever the number of processes.

        ``function``: a function of a module, which other processes can import. ``jobs``: its arguments, one after
        another. ``part``: jobs that a process is given at once.
        """
        parts = [jobs[first : first + part] for first in range(0, len(jobs), part)]
        results: list[DoneT] = []
        self.progress(stage, 0, len(jobs))
        for done in in_order(partial(_all, function), parts, workers=min(self.workers, max(1, len(parts)))):
            results += done
            self.progress(stage, len(results), len(jobs))
        return results


def _all(function: Callable[[Job], DoneT], jobs: Sequence[Job]) -> list[DoneT]:
    return [function(job) for job in jobs]


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSearch:
    """One search, with the answers of the shorter searches that it contains."""

    place: str
    """What was searched: a material, a user's bank, or the condition of Fig. 5."""
    peak_snr_db: float | None
    """Noise of a simulation; None for a user's own bank."""
    method: PaperMethod
    position: int = 1
    """At which of the nine positions, counted from 1."""
    repeat: int = 0
    """Number of the visit to the nine positions."""
    truth_deg: float
    """Angle that counts as true."""
    track_deg: tuple[float, ...]
    """Angles reached, one for each acquisition."""
    answers_deg: dict[int, float]
    """By number of acquisitions."""

    def error_deg(self, acquisitions: int) -> float:
        """Return the absolute error of the answer after this number of acquisitions."""
        return abs(self.answers_deg[acquisitions] - self.truth_deg)


def paper_search(
    policy: Policy,
    rig: Rig,
    *,
    method: PaperMethod,
    truth_deg: float,
    counts: Sequence[int] = (),
    stay: bool = True,
    **what: Any,
) -> PaperSearch:
    """Return the search on a rig.

    ``counts``: numbers of acquisitions after which the answer is kept; empty: at the end. ``what``: the other fields.
    """
    plan = SearchPlan(method=BUILT[method], as_published=True, stay=stay)
    found = searched(policy, rig, plan, counts=counts)
    answers = found.answers or {len(found.samples): found.finished.estimate}
    return PaperSearch(
        method=method,
        truth_deg=truth_deg,
        track_deg=tuple(sample.angle_deg for sample in found.samples),
        answers_deg={count: each.mean_deg for count, each in answers.items()},
        **what,
    )


def policy_of(
    name: PaperMethod, *, acquisitions: int, limits: Interval = PAPER_RANGE, early_end: bool = False
) -> Policy:
    """Return the policy of a method as published, which always answers.

    ``acquisitions``: number N of acquisitions, all of them made unless it may end early. ``early_end``: whether WA ends
    once the peak is recorded and passed, as it does online.
    """
    plan = SearchPlan(method=BUILT[name], acquisitions=acquisitions, as_published=True, early_end=early_end)
    return build(plan, limits=limits)


@dataclass(frozen=True, slots=True, kw_only=True)
class QuantisedPolicy:
    """A policy whose angles are rounded to the encoder counts of the motor.

    Section 2.5 gives offline searches the numerical precision of the motor, by interpolating the bank.
    """

    policy: Policy
    limits: Interval
    """Range of the bank; an angle that rounding would move out of the range is not rounded."""

    def ask(self) -> float | None:
        """Return the next angle of the policy at the nearest count, in degrees; None at its end."""
        asked_deg = self.policy.ask()
        if asked_deg is None:
            return None
        counts_per_deg = StageMotion().counts_per_deg
        nearest_deg = round(asked_deg * counts_per_deg) / counts_per_deg
        # At an end rounding may leave the bank, where there is nothing to interpolate.
        return nearest_deg if nearest_deg in self.limits else asked_deg

    def tell(self, sample: Sample) -> None:
        """Hand the sample to the policy."""
        self.policy.tell(sample)

    def estimate(self) -> Estimate:
        """Return the answer of the policy."""
        return self.policy.estimate()
