"""What a run reports while it goes: Started, then Asked with Measured or Refused, then Finished or Failed.

`Measured` is handed out before the policy is told: whoever keeps a record commits it first.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from markerseek.core.estimate import Estimate
from markerseek.core.frame import Frame
from markerseek.core.interval import Interval
from markerseek.core.reading import Sample


@dataclass(frozen=True, slots=True, kw_only=True)
class Started:
    """The search begins: where the probe stands, and the angles that may be searched."""

    start_deg: float
    limits: Interval


Role: TypeAlias = Literal["dark", "search", "confirmation"]
"""What an acquisition is for: a dark frame before the search, one that the policy asked for, one after it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """One acquisition is about to be made: the stage is sent to an angle, and leave to fire is asked for there.

    Attributes
    ----------
    role, index
        As in `Measured`.
    angle_deg
        Where the stage is sent, in degrees; a dark frame is taken where it stands.
    """

    role: Role
    index: int
    angle_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """One acquisition was made.

    Attributes
    ----------
    role
        See `Role`.
    index
        Number of the acquisition within its role, counted from 1.
    sample
        What was measured.
    """

    role: Role
    index: int
    sample: Sample


@dataclass(frozen=True, slots=True, kw_only=True)
class Refused:
    """An acquisition was refused and will be tried again.

    Attributes
    ----------
    angle_deg
        Angle in degrees at which it was asked for.
    reason
        Why.
    frame
        What the receiver sent; None where it sent nothing.
    """

    angle_deg: float
    reason: str
    frame: Frame | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """The search is over.

    Attributes
    ----------
    estimate
        The answer.
    confirmation
        One acquisition at the angle found, after the last move; None if the policy did not find a marker.
    acquisitions
        Number of acquisitions that the policy was told, dark ones and the confirmation apart.
    travel_deg
        Rotation from the first place to the last by the stage's readback, in degrees.
    elapsed_s
        Time on the rig's clock from `Started`, in seconds.
    """

    estimate: Estimate
    confirmation: Sample | None
    acquisitions: int
    travel_deg: float
    elapsed_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Failed:
    """The run ends with an error and without an angle; the error is raised next."""

    error: Exception


Event: TypeAlias = Started | Asked | Measured | Refused | Finished | Failed
