"""Plan of a search: method, number of acquisitions, start and end. It does not depend on the rig."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core.checks import is_finite, is_whole
from markerseek.core.errors import ConfigError
from markerseek.core.marker_curve import MarkerCurve
from markerseek.core.reading import MOST_ACQUISITIONS

MOST_DARK_FRAMES = 100
"""Most dark frames before a search."""


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
    single
        Whether there is one source only, so that a posterior looks for no other.
    prior
        Intensity curve of a former marker on this rig, for a posterior; None if there was none.
    dark_frames
        Acquisitions without laser before the first.
    stay
        Whether the last move and the confirmation are left out.
    closing_dark
        Whether it ends with an acquisition without laser.

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
    single: bool = False
    prior: MarkerCurve | None = None
    dark_frames: int = 0
    stay: bool = False
    closing_dark: bool = False

    def __post_init__(self) -> None:
        # Checked before any device is opened: a plan comes from a command line or a page.
        number = self.acquisitions
        if number is not None and not (is_whole(number) and 0 <= number <= MOST_ACQUISITIONS):
            raise ConfigError(
                f"acquisitions is {number}, it must be a whole number between 0 and {MOST_ACQUISITIONS}; leave it out "
                "for the number of the method"
            )
        if self.start_deg is not None and not is_finite(self.start_deg):
            raise ConfigError(f"start_deg is {self.start_deg} deg, it must be a finite number")
        if not (is_whole(self.dark_frames) and 0 <= self.dark_frames <= MOST_DARK_FRAMES):
            raise ConfigError(f"dark_frames is {self.dark_frames}, it must lie between 0 and {MOST_DARK_FRAMES}")
