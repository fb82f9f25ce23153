"""The paper's three methods in their published form, and how they are run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal, TypeAlias

from markerseek.core import PAPER_RANGE, Estimate, Finished, Interval, Measured, Policy, Reading, Sample, SearchError
from markerseek.scan import Scanner, run
from markerseek.search import build
from markerseek.sim import StageMotion

PaperMethod: TypeAlias = Literal["TS", "GSS", "WA"]
"""Ternary search, golden-section search, weighted average."""

PAPER_METHODS: tuple[PaperMethod, ...] = ("TS", "GSS", "WA")
BRACKETS: tuple[PaperMethod, ...] = ("TS", "GSS")

BRACKET_ACQUISITIONS = tuple(range(2, 29, 2))
"""N of TS and GSS in Fig. 5 to 7."""

AVERAGE_ACQUISITIONS = tuple(range(8, 29))
"""N of WA in Fig. 5 and 6: full scans."""

TABLE_ACQUISITIONS = 16
"""N of Table 1, Table 2 and of the rotation travel."""

ONLINE_STEPS = 15
"""Acquisitions of WA over the whole range in 5° steps (section 3.3)."""

BUILT: dict[PaperMethod, str] = {"TS": "ternary", "GSS": "golden-section", "WA": "weighted-average"}
"""Names in `markerseek.search`."""


def published(
    name: PaperMethod, *, acquisitions: int, limits: Interval = PAPER_RANGE, early_end: bool = False
) -> Policy:
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


class OnEncoderCounts:
    """A policy whose angles are rounded to the encoder counts of the motor.

    Section 2.5 gives offline searches the numerical precision of the motor, by interpolating the bank.

    Parameters
    ----------
    policy
        The policy.
    limits
        Range of the bank; an angle that rounding would move out of it is not rounded.
    """

    def __init__(self, policy: Policy, *, limits: Interval) -> None:
        self._policy = policy
        self._limits = limits
        self._counts_per_deg = StageMotion().counts_per_deg

    def ask(self) -> float | None:
        """Next angle of the policy at the nearest count, in degrees; None at its end."""
        asked_deg = self._policy.ask()
        if asked_deg is None:
            return None
        nearest_deg = round(asked_deg * self._counts_per_deg) / self._counts_per_deg
        # At an end rounding may leave the bank, where there is nothing to interpolate.
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
    """Run a search on a rig, and return its samples in order and its end.

    Parameters
    ----------
    policy, scanner
        The policy, and the scanner of its rig.
    stay
        Whether to leave out the last move to the angle found, and the confirmation there.
    dark_frames
        Acquisitions without laser before the first.

    Raises
    ------
    MarkerseekError
        Whatever ended the run.
    """
    samples: list[Sample] = []
    for event in run(policy, scanner, stay=stay, dark_frames=dark_frames):
        # Without the confirmation at the end, which is not one of the paper's acquisitions.
        if isinstance(event, Measured) and event.role == "search":
            samples.append(event.sample)
        elif isinstance(event, Finished):
            return samples, event
    raise SearchError("the run ended without an answer")


def shorter(
    name: PaperMethod, samples: Sequence[Sample], *, limits: Interval = PAPER_RANGE
) -> Iterator[tuple[int, float]]:
    """Answers of all shorter searches that one search of TS or GSS contains.

    The angles of a bracket search do not depend on its length: its first N samples are those of a search of N
    acquisitions.

    Parameters
    ----------
    name
        TS or GSS.
    samples
        Samples of the longest search, in order.
    limits
        Range to search.

    Yields
    ------
    tuple of int and float
        N = 2, 4, … and the angle answered, in degrees.
    """
    # The samples are replayed into a new policy, whose answers on the way are those of the shorter searches.
    policy = published(name, acquisitions=len(samples), limits=limits)
    for count, sample in enumerate(samples, start=1):
        policy.tell(sample)
        if count % 2 == 0:
            yield count, policy.estimate().mean_deg


def noise_free_track(name: PaperMethod, marker_deg: float, *, acquisitions: int) -> tuple[list[float], float]:
    """Angles that a method requests without noise, in order, and its answer, in degrees.

    They follow from the marker's angle alone: of two angles the one nearer to the marker is the stronger, on every
    symmetric unimodal curve.

    Parameters
    ----------
    name
        The method; a full scan for WA.
    marker_deg
        Angle of the marker in degrees.
    acquisitions
        Number N of acquisitions.
    """
    policy = published(name, acquisitions=acquisitions)
    track: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        track.append(angle_deg)
        # Any curve that falls with the distance: bracket searches only compare intensities.
        reading = Reading(intensity=1.0 / (1.0 + (angle_deg - marker_deg) ** 2))
        policy.tell(Sample(angle_deg=angle_deg, reading=reading))
    return track, policy.estimate().mean_deg
