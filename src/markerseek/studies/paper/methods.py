"""The paper's three methods as it ran them, and one run for all numbers of acquisitions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, TypeAlias

from markerseek.core import PAPER_RANGE, Interval, Policy, Sample, SearchError
from markerseek.core.estimate import Estimate
from markerseek.core.events import Finished, Measured
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.sim import StageMotion

Name: TypeAlias = Literal["TS", "GSS", "WA"]
"""Ternary search, golden-section search, weighted average."""

NAMES: tuple[Name, ...] = ("TS", "GSS", "WA")
BRACKETS: tuple[Name, ...] = ("TS", "GSS")

BRACKET_ACQUISITIONS = tuple(range(2, 29, 2))
"""N of TS and GSS in Fig. 5 to 7."""

AVERAGE_ACQUISITIONS = tuple(range(8, 29))
"""N of WA in Fig. 5 and 6: full scans."""

TABLE_ACQUISITIONS = 16
"""N of Table 1, Table 2 and of the rotation travel."""

ONLINE_STEPS = 15
"""Acquisitions of WA over the whole range in 5° steps (section 3.3)."""

BUILT: dict[Name, str] = {"TS": "ternary", "GSS": "golden-section", "WA": "weighted-average"}
"""What each is called in `markerseek.search`."""


def published(name: Name, *, acquisitions: int, limits: Interval = PAPER_RANGE, early_end: bool = False) -> Policy:
    """Policy of a method in its published form, which always answers.

    Parameters
    ----------
    name
        Its name in the paper.
    acquisitions
        Number N of acquisitions.
    limits
        Range to search.
    early_end
        Whether WA ends once the peak is recorded and passed, as it does online.
    """
    return build(BUILT[name], limits=limits, acquisitions=acquisitions, as_published=True, early_end=early_end)


class OnCounts:
    """A policy whose angles are those that the motor's encoder can stand at.

    Section 2.5 gives offline searches the numerical precision of the motor, by interpolating the bank.

    Parameters
    ----------
    policy
        What searches.
    limits
        Range recorded, which no rounding leaves.
    counts_per_deg
        Encoder counts for one degree.
    """

    def __init__(
        self, policy: Policy, *, limits: Interval, counts_per_deg: float = StageMotion().counts_per_deg
    ) -> None:
        self._policy = policy
        self._limits = limits
        self._counts_per_deg = counts_per_deg

    def ask(self) -> float | None:
        """Next angle of the policy at the nearest count, in degrees; None at its end."""
        asked_deg = self._policy.ask()
        if asked_deg is None:
            return None
        nearest_deg = round(asked_deg * self._counts_per_deg) / self._counts_per_deg
        return nearest_deg if nearest_deg in self._limits else asked_deg

    def tell(self, sample: Sample) -> None:
        """Hand the sample to the policy."""
        self._policy.tell(sample)

    def estimate(self) -> Estimate:
        """Answer of the policy."""
        return self._policy.estimate()


def searched(
    policy: Policy, scanner: Scanner, *, stay: bool = True, dark_frames: int = 0
) -> tuple[list[Sample], Finished]:
    """Samples of a search on a rig, in order, and how it ended.

    Parameters
    ----------
    policy, scanner
        What searches, on what.
    stay
        Whether the last move to the angle found, and the confirmation there, are left out.
    dark_frames
        Acquisitions without laser before the first.

    Raises
    ------
    MarkerseekError
        Whatever ended the run.
    """
    samples: list[Sample] = []
    for event in run(policy, scanner, stay=stay, dark_frames=dark_frames):
        if isinstance(event, Measured) and event.role == "search":
            samples.append(event.sample)
        elif isinstance(event, Finished):
            return samples, event
    raise SearchError("the run ended without an answer")


def shorter(name: Name, samples: Sequence[Sample], *, limits: Interval = PAPER_RANGE) -> Iterator[tuple[int, float]]:
    """Answers of all shorter searches that one search of TS or GSS contains.

    A bracket search asks the same questions however long it will be, so that its first N samples are those of a search
    of N acquisitions.

    Parameters
    ----------
    name
        TS or GSS.
    samples
        Samples of the longest search, in order.
    limits
        Range searched.

    Yields
    ------
    tuple of int and float
        N = 2, 4, … and the angle answered, in degrees.
    """
    policy = published(name, acquisitions=len(samples), limits=limits)
    for count, sample in enumerate(samples, start=1):
        policy.tell(sample)
        if count % 2 == 0:
            yield count, policy.estimate().mean_deg
