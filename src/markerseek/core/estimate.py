"""The possible answers of a search. All state the same facts (`Answer`); only `Found` claims a marker."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec

from markerseek.core.checks import Within, require_fields
from markerseek.core.interval import Interval
from markerseek.core.reading import MAX_INTENSITY, MIN_INTENSITY

IntervalKind: TypeAlias = Literal["posterior", "bracket", "propagated"]
"""Where an interval comes from: a probability, the width left of a bracket, or noise propagated through a formula."""


Doubt: TypeAlias = Literal["source", "width"]
"""Why an answer is `Unsure`: it is not known that this source is the marker, or its angle is not known well enough."""


FALSE_FOUND = 1e-3
"""Probability p that noise alone exceeds the threshold somewhere in a search."""


class Floor(msgspec.Struct, frozen=True, kw_only=True):
    """Noise floor: an intensity that is not above ``level`` is no evidence of a marker.

    Attributes
    ----------
    level
        Threshold, in the unit of the intensities; None if the floor is unknown.
    source
        Data from which it was computed.
    background
        Intensity that lies below all samples, with laser and marker or without; None if noise explains the lowest ones.
    """

    level: float | None
    source: Literal["dark frames", "noise of the frames", "lower quartile", "unknown"]
    background: float | None = None


class OtherSource(msgspec.Struct, frozen=True, kw_only=True):
    """A source beside the one answered: clutter, a repeat of the sound, or a second marker.

    Attributes
    ----------
    angle_deg, sigma_deg
        Its angle and the standard deviation of the angle, in degrees.
    relative_db
        Its strength with the probe on it over that of the source found, in dB.
    lateral_m, depth_m
        Its position in the image, in metres; None if the frames do not state it.
    """

    angle_deg: float
    sigma_deg: float
    relative_db: float
    lateral_m: float | None = None
    depth_m: float | None = None


class MarkerMotion(msgspec.Struct, frozen=True, kw_only=True):
    """What a search has seen of the marker's motion, and what it has left room for.

    Attributes
    ----------
    lateral_mm, depth_mm
        Amplitude of the motion along the array and in depth, in mm, as far as the frames show it: half of the way, and
        0 where they show none. None if they cannot show it: intensities alone do not, nor does a single frame.
    turn_sigma_mm
        Standard deviation of the displacement along the turn that the interval has room for, in mm. That displacement
        does not show in a frame.
    cameras_mm
        Amplitude of the displacements of the samples that cameras saw, in mm: half of the way; they are taken out. None
        where no camera followed the tissue.
    left_mm
        Standard deviation along the turn of what the cameras leave open of the displacement of a sample, in mm.
    period_s
        Time from breath to breath in seconds, where the times of the samples show it.
    turn_looked_at
        Whether a flank of the curve was measured at two times, so that a motion along the turn would probably have been
        seen.
    """

    lateral_mm: float | None = None
    depth_mm: float | None = None
    turn_sigma_mm: float = 0.0
    cameras_mm: float | None = None
    left_mm: float = 0.0
    period_s: float | None = None
    turn_looked_at: bool = False

    @property
    def is_seen(self) -> bool:
        """Whether the marker moves: the frames show it, or the samples scatter as if it did."""
        return max(self.lateral_mm or 0.0, self.depth_mm or 0.0) > 0 or self.turn_sigma_mm > _SCATTERED_MM


_SCATTERED_MM = 0.2
"""Displacement along the turn, as a standard deviation, from which the samples are said to scatter."""


class Answer(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """What every answer of a search states; which answer it is, says its class.

    Attributes
    ----------
    mean_deg
        Best angle of the method in degrees, also if no marker is claimed there.
    sigma_deg
        Standard deviation of that angle in degrees; None if the method has none, and if nothing was detected.
    interval95_deg
        Interval that is meant to hold the marker in 95 of 100 searches; None as for ``sigma_deg``.
    interval_kind
        Where the interval comes from; only ``posterior`` is a probability.
    half_width_m
        How far the interval reaches from the angle, as a length at the marker in metres; None if the distance of the
        marker from the axis is not known.
    floor
        Detection threshold that the evidence had to exceed; None in the paper's form of a method, which asks for none.
    others
        Further sources, the strongest first.
    surveyed
        Share of the range in which a second source as strong would have been detected, 0 to 1; None if not known.
    outliers_deg
        Angles of samples that were left out, because they are far stronger than those beside them.
    other_probability
        Probability that another source is the marker, 0 to 1; None if the method does not compute it.
    motion
        What was seen of the marker's motion; None if the method does not look for it.
    """

    mean_deg: float
    sigma_deg: float | None = None
    interval95_deg: Interval | None = None
    interval_kind: IntervalKind | None = None
    half_width_m: float | None = None
    floor: Floor | None = None
    others: tuple[OtherSource, ...] = ()
    surveyed: float | None = None
    outliers_deg: tuple[float, ...] = ()
    other_probability: float | None = None
    motion: MarkerMotion | None = None


class Found(Answer, frozen=True, kw_only=True):
    """A marker was found at this angle."""

    sigma_deg: float
    interval95_deg: Interval
    interval_kind: IntervalKind
    curve: MarkerCurve | None = None
    """Its intensity curve; None if the method does not know it."""

    def as_unsure(self, doubt: Doubt, reason: str) -> Unsure:
        """Return the same angle, no longer claimed."""
        kept = {name: getattr(self, name) for name in Answer.__struct_fields__}
        return Unsure(doubt=doubt, reason=reason, **kept)


class NotFound(Answer, frozen=True, kw_only=True):
    """No intensity is above the noise; ``mean_deg`` is the angle that the method would have given."""

    reason: str


class Ambiguous(Answer, frozen=True, kw_only=True):
    """Two sources about as strong, or one source whose angle is one of several.

    ``modes_deg`` lists the angles; ``mean_deg``, ``sigma_deg`` and ``interval95_deg`` are those of the strongest
    source, or of the likeliest.
    """

    modes_deg: tuple[float, ...]


class AtBound(Answer, frozen=True, kw_only=True):
    """The intensity still rises at an end of the range: the marker lies there or beyond.

    ``sigma_deg`` and ``interval95_deg`` are those of the marker, which may lie beyond.
    """

    side: Literal["low", "high"]


class Unsure(Answer, frozen=True, kw_only=True):
    """There is a marker, but it is not known that this source is it, or its angle is not known well enough.

    ``doubt`` says which of the two; with "width" the source is the marker.
    """

    sigma_deg: float
    interval95_deg: Interval
    interval_kind: IntervalKind
    reason: str
    doubt: Doubt


# Not `Answer` itself: a match statement over a union is checked for missing cases by mypy.
Estimate: TypeAlias = Found | NotFound | Ambiguous | AtBound | Unsure


class MarkerCurve(msgspec.Struct, frozen=True, kw_only=True):
    """The intensity curve of a marker that was found.

    Attributes
    ----------
    fwhm_deg
        Full width at half maximum, in degrees.
    peak
        Intensity with the probe on the marker, in the unit of the frames.

    Raises
    ------
    ConfigError
        If a number is not finite, or out of range.
    """

    fwhm_deg: Annotated[float, Within(0.5, 90.0, "deg")]
    peak: Annotated[float, Within(MIN_INTENSITY, MAX_INTENSITY)]

    def __post_init__(self) -> None:
        require_fields(self, "marker curve")
