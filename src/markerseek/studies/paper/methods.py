"""The paper's three methods as published, the posterior beside them, and how they are run."""

from __future__ import annotations

from typing import Literal, TypeAlias

from markerseek.core import (
    PAPER_RANGE,
    Estimate,
    Interval,
    Policy,
    Reading,
    Sample,
    SearchPlan,
)
from markerseek.search import build
from markerseek.sim import StageMotion

PaperMethod: TypeAlias = Literal["TS", "GSS", "WA"]
"""Ternary search, golden-section search, weighted average."""

AnyMethod: TypeAlias = PaperMethod | Literal["posterior"]
"""A method of the paper, or the posterior, which is ours."""

PAPER_METHODS: tuple[PaperMethod, ...] = ("TS", "GSS", "WA")
BRACKETS: tuple[PaperMethod, ...] = ("TS", "GSS")

ALL_METHODS: tuple[AnyMethod, ...] = (*PAPER_METHODS, "posterior")

BRACKET_ACQUISITIONS = tuple(range(2, 29, 2))
"""N of TS and GSS in Fig. 5 to 7, and of the posterior beside them."""

AVERAGE_ACQUISITIONS = tuple(range(8, 29))
"""N of WA in Fig. 5 and 6: full scans."""

TABLE_ACQUISITIONS = 16
"""N of Table 1, Table 2 and of the rotation travel."""

ONLINE_STEPS = 15
"""Acquisitions of WA over the whole range in 5° steps (section 3.3)."""

BUILT: dict[AnyMethod, str] = {
    "TS": "ternary",
    "GSS": "golden-section",
    "WA": "weighted-average",
    "posterior": "posterior",
}
"""Names in `markerseek.search`."""


def policy_of(
    name: AnyMethod,
    *,
    acquisitions: int,
    limits: Interval = PAPER_RANGE,
    start_deg: float | None = None,
    early_end: bool = False,
) -> Policy:
    """Policy of a method: published ones always answer, the posterior knows that there is one source, as they assume.

    ``acquisitions``: number N of acquisitions, all of them made unless it may end early. ``start_deg``: angle of the
    probe, for the posterior. ``early_end``: whether WA ends once the peak is recorded and passed, as it does online, or
    the posterior once the angle is known well enough.
    """
    return build(
        SearchPlan(
            method=BUILT[name],
            acquisitions=acquisitions,
            as_published=name != "posterior",
            start_deg=start_deg,
            early_end=early_end,
            others=0.0 if name == "posterior" else None,
        ),
        limits=limits,
    )


class QuantisedPolicy:
    """A policy whose angles are rounded to the encoder counts of the motor.

    Section 2.5 gives offline searches the numerical precision of the motor, by interpolating the bank.

    ``limits``: range of the bank; an angle that rounding would move out of it is not rounded.
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


def noise_free_track(name: PaperMethod, marker_deg: float, *, acquisitions: int) -> tuple[list[float], float]:
    """Angles that a method requests without noise, in order, and its answer, in degrees.

    They follow from the marker's angle alone: of two angles the one nearer to the marker is the stronger, on every
    symmetric unimodal curve.

    ``name``: a full scan for WA.
    """
    policy = policy_of(name, acquisitions=acquisitions)
    track: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        track.append(angle_deg)
        # Any curve that falls with the distance: bracket searches only compare intensities.
        reading = Reading(intensity=1.0 / (1.0 + (angle_deg - marker_deg) ** 2))
        policy.tell(Sample(angle_deg=angle_deg, reading=reading))
    return track, policy.estimate().mean_deg
