"""What a policy believes of the marker's angle, as the record of a run keeps it."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core.estimate import Estimate, NotFound


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleBelief:
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
        """Standard deviation in degrees; None where the answer has none."""
        return None if not self.claims or isinstance(self.estimate, NotFound) else self.estimate.sigma_deg

    @property
    def interval95_deg(self) -> tuple[float, float] | None:
        """95 % interval in degrees; None where the answer has none."""
        interval = None if not self.claims or isinstance(self.estimate, NotFound) else self.estimate.interval95_deg
        return None if interval is None else (interval.low_deg, interval.high_deg)
