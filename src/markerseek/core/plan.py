"""Plan of a search: method, number of acquisitions, start and end. It does not depend on the rig."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from markerseek.core.checks import is_finite, is_whole
from markerseek.core.errors import ConfigError
from markerseek.core.marker_curve import MarkerCurve
from markerseek.core.reading import MAX_ACQUISITIONS

MAX_DARK_FRAMES = 100
"""Most dark frames before a search."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """How far the 95 % interval of a marker that is found may reach from its angle.

    Attributes
    ----------
    mm
        As a length at the marker to either side, in millimetres.
    deg
        As an angle to either side, in degrees, where the distance of the marker from the axis is not known.

    Raises
    ------
    ConfigError
        If one of them is not positive.
    """

    mm: float = 1.0
    deg: float = 1.0

    def __post_init__(self) -> None:
        for name in ("mm", "deg"):
            value = getattr(self, name)
            if not (is_finite(value) and value > 0):
                raise ConfigError(f"tolerance is {value} {name}, it must be a positive number")

    def half_width_deg(self, radius_m: float | None) -> float:
        """The tolerance to either side in degrees, for a marker at this distance from the axis in metres."""
        return self.deg if radius_m is None else math.degrees(1e-3 * self.mm / radius_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPlan:
    """Plan of a search; the range of angles belongs to the rig (`RigFacts.search`).

    Attributes
    ----------
    method
        Name of the method, one of `markerseek.search.METHODS`.
    acquisitions
        Most acquisitions; None: the method's own number.
    as_published
        Whether the paper's form of the method is wanted, which always answers.
    start_deg
        Angle of the probe, in degrees: checked sweeps and the manual search begin at the nearer end. None: they begin
        at the low end.
    early_end
        Whether a weighted average ends once its peak is recorded and passed, and a posterior once its angle is known
        well enough.
    others
        Prior probability that there is another source as loud, for a posterior; 0: it looks for none. None: as usual.
    prior
        Intensity curve of a former marker on this rig, for a posterior; None if there was none.
    dark_frames
        Acquisitions without laser before the first.
    stay
        Whether the last move and the confirmation are left out.
    sweep_speed_deg_s
        Speed of the sweeps of which the search consists, in degrees per second; None stops for each acquisition.
    closing_dark
        Whether it ends with an acquisition without laser.
    tolerance
        How well the angle of a marker that is found must be known.

    Raises
    ------
    ConfigError
        If a number cannot be used; whether the method exists, and how many acquisitions it needs, is checked when the
        policy is built.
    """

    method: str
    acquisitions: int | None = None
    as_published: bool = False
    start_deg: float | None = None
    early_end: bool = True
    others: float | None = None
    prior: MarkerCurve | None = None
    dark_frames: int = 0
    stay: bool = False
    sweep_speed_deg_s: float | None = None
    closing_dark: bool = False
    tolerance: Tolerance = field(default_factory=Tolerance)

    def __post_init__(self) -> None:
        # Checked before any device is opened: a plan comes from a command line or a page.
        number = self.acquisitions
        if number is not None and not (is_whole(number) and 0 <= number <= MAX_ACQUISITIONS):
            raise ConfigError(
                f"acquisitions is {number}, it must be a whole number between 0 and {MAX_ACQUISITIONS}; leave it out "
                "for the number of the method"
            )
        if self.others is not None and not (is_finite(self.others) and 0 <= self.others < 1):
            raise ConfigError(f"others is {self.others}, it must be a probability from 0 to below 1")
        if self.start_deg is not None and not is_finite(self.start_deg):
            raise ConfigError(f"start_deg is {self.start_deg} deg, it must be a finite number")
        if self.sweep_speed_deg_s is not None and not (
            is_finite(self.sweep_speed_deg_s) and self.sweep_speed_deg_s > 0
        ):
            raise ConfigError(f"sweep_speed_deg_s is {self.sweep_speed_deg_s} deg/s, it must be a positive number")
        if not (is_whole(self.dark_frames) and 0 <= self.dark_frames <= MAX_DARK_FRAMES):
            raise ConfigError(f"dark_frames is {self.dark_frames}, it must lie between 0 and {MAX_DARK_FRAMES}")
