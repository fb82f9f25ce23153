"""The possible answers of a search. Each has ``mean_deg``; only `Found` claims a marker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from markerseek.core.interval import Interval

IntervalKind: TypeAlias = Literal["posterior", "bracket", "propagated"]
"""Where an interval comes from: a probability, the width left of a bracket, or noise propagated through a formula."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Noise floor: an intensity that is not above ``level`` is no evidence of a marker.

    Attributes
    ----------
    level
        Threshold, in the unit of the intensities; None where the floor is unknown.
    source
        Data from which it was computed.
    """

    level: float | None
    source: Literal["dark frames", "noise of the frames", "lower quartile", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A marker was found at this angle.

    Attributes
    ----------
    mean_deg
        Angle of the marker in degrees.
    sigma_deg
        Standard deviation of that angle in degrees.
    interval95_deg
        Interval that is meant to hold the marker in 95 of 100 searches.
    interval_kind
        Where the interval comes from; only ``posterior`` is a probability.
    floor
        The noise floor that the evidence had to exceed; None in the paper's form of a method, which asks for none.
    """

    mean_deg: float
    sigma_deg: float
    interval95_deg: Interval
    interval_kind: IntervalKind
    floor: Floor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NotFound:
    """No intensity is above the noise; ``mean_deg`` is the angle that the method would have given."""

    mean_deg: float
    reason: str
    floor: Floor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ambiguous:
    """More than one angle explains the intensities; ``modes_deg`` lists them, ``mean_deg`` is the likeliest."""

    mean_deg: float
    modes_deg: tuple[float, ...]
    floor: Floor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AtBound:
    """The intensity still rises at an end of the range: the marker lies there or beyond."""

    mean_deg: float
    side: Literal["low", "high"]
    floor: Floor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Unsure:
    """There is a marker, but its angle is not known well enough."""

    mean_deg: float
    sigma_deg: float
    interval95_deg: Interval
    interval_kind: IntervalKind
    reason: str
    floor: Floor | None = None


# A union and no base class: a match statement over it is checked for missing cases by mypy.
Estimate: TypeAlias = Found | NotFound | Ambiguous | AtBound | Unsure
