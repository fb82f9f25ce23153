"""Events of a run, in order: Started, then Asked with Measured or Refused, then Finished or Failed.

Where a person turns the probe, `Turning` follows `Asked` until it is there.

`Measured` is yielded before the policy receives the sample, so that a journal can commit it first.
"""

from __future__ import annotations

from typing import ClassVar, Literal, TypeAlias

import msgspec

from markerseek.core.angle_prior import PriorEvidence
from markerseek.core.estimate import Estimate
from markerseek.core.interval import Interval
from markerseek.core.reading import Frame, Sample
from markerseek.core.sweep import Sweep
from markerseek.core.values import EqualWithout


class Started(msgspec.Struct, frozen=True, kw_only=True):
    """The search begins: angle of the probe, and the angles that may be searched."""

    start_deg: float
    limits: Interval


Role: TypeAlias = Literal["dark", "search", "confirmation"]
"""Purpose of an acquisition: a dark frame, one that the policy asked for, or the confirmation after the search."""


class Asked(EqualWithout, frozen=True, kw_only=True):
    """One acquisition is about to be made: a move to an angle, then a permit to fire there; or a sweep.

    Attributes
    ----------
    role, index
        As in `Measured`; for a sweep, of its first sample.
    angle_deg
        Angle that the stage is sent to, in degrees; for a dark frame, the present one; for a sweep, its end.
    sweep
        The sweep; a `Measured` or `Refused` follows for each of its pulses, and `Swept` at its end. None for one
        acquisition at an angle.
    belief
        What the policy believed when it asked; None before the first acquisition with light, and in a run without a
        record.
    """

    # A run without a record asks for the same, and has no belief.
    left_out: ClassVar[str] = "belief"
    role: Role
    index: int
    angle_deg: float
    sweep: Sweep | None = None
    belief: AngleBelief | None = None


class Turning(msgspec.Struct, frozen=True, kw_only=True):
    """A person is asked to turn the probe, or turns it.

    Attributes
    ----------
    target_deg
        Angle asked for, in degrees.
    angle_deg
        Angle read now, in degrees; None if the person reads it, and types it in at the end.
    """

    target_deg: float
    angle_deg: float | None


class Measured(msgspec.Struct, frozen=True, kw_only=True):
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


class Swept(msgspec.Struct, frozen=True, kw_only=True):
    """A sweep is over, and the probe is at rest.

    Attributes
    ----------
    angle_deg
        Readback in degrees: where the sweep ended, or where the probe waited for its frames.
    pulses
        How many pulses were fired in it.
    """

    angle_deg: float
    pulses: int


class Refused(EqualWithout, frozen=True, kw_only=True):
    """An acquisition was refused and will be tried again; that of one pulse of a sweep is left out.

    Attributes
    ----------
    angle_deg
        Angle in degrees at which it was asked for, in a sweep that at the pulse.
    reason
        Why.
    frame
        What the receiver sent; None if it sent nothing.
    """

    left_out: ClassVar[str] = "frame"
    angle_deg: float
    reason: str
    frame: Frame | None = None


class Searched(msgspec.Struct, frozen=True, kw_only=True):
    """What a search of a recording took and said, before the other angles of the recording were taken.

    Attributes
    ----------
    estimate
        Its answer.
    acquisitions
        Number of its acquisitions with light: the first of the run.
    """

    estimate: Estimate
    acquisitions: int


class Finished(EqualWithout, frozen=True, kw_only=True):
    """The search is over.

    Attributes
    ----------
    estimate
        The answer.
    confirmation
        One acquisition at the angle found, after the last move; None if the policy did not find a marker.
    acquisitions
        Number of acquisitions with light that the policy received; the confirmation does not count.
    travel_deg
        Sum of all rotations by the stage's readback, in degrees.
    elapsed_s
        Time on the rig's clock from `Started`, in seconds, with the move of the probe to a marker that was found.
    known_s
        The same time without the move of the probe to the marker; None if no marker was found.
    searched
        Answer of the search alone, if the answer is from all angles of a recording; else None.
    near
        Evidence for the prior over the angle; None if the search had no prior.
    belief
        As in `Asked`.
    """

    left_out: ClassVar[str] = "belief"
    estimate: Estimate
    confirmation: Sample | None
    acquisitions: int
    travel_deg: float
    elapsed_s: float
    known_s: float | None = None
    searched: Searched | None = None
    near: PriorEvidence | None = None
    belief: AngleBelief | None = None


class Failed(msgspec.Struct, frozen=True, kw_only=True):
    """The run ends with an error and without an angle; the error is raised next."""

    error: Exception


# A union and no base class, as for `Estimate`.
Event: TypeAlias = Started | Asked | Turning | Measured | Swept | Refused | Finished | Failed


class AngleBelief(msgspec.Struct, frozen=True, kw_only=True):
    """Where the marker is, as far as a search knows: for pictures; no decision is made from it."""

    estimate: Estimate
    """The answer that the search would give now."""
    claims: bool = True
    """Whether the method claims anything; the paper's form always answers, and claims nothing."""
    angles_deg: tuple[float, ...] = ()
    density_per_deg: tuple[float, ...] = ()
    """``angles_deg`` and ``density_per_deg``: angles, ascending, and the probability density of the marker there; empty
    for a method without one."""
    bracket_deg: tuple[float, float] | None = None
    """Both ends of the part of the range that is left; None for a method without a bracket."""
    weights: tuple[float, ...] = ()
    """Weight of each sample in a weighted average, 0 to 1; empty for other methods."""
    choice_deg: tuple[float, ...] = ()
    choice_sigma_deg: tuple[float, ...] = ()
    """``choice_deg`` and ``choice_sigma_deg``: angles in degrees that were weighed up for the next acquisition, and the
    standard deviation expected after one there; empty for a method that does not weigh them up."""

    @property
    def sigma_deg(self) -> float | None:
        """Standard deviation in degrees; None if the answer has none."""
        return self.estimate.sigma_deg if self.claims else None

    @property
    def interval95_deg(self) -> tuple[float, float] | None:
        """95 % interval in degrees; None if the answer has none."""
        interval = self.estimate.interval95_deg if self.claims else None
        return None if interval is None else (interval.low_deg, interval.high_deg)
