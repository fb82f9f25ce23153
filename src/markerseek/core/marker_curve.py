"""Width and height of a marker's intensity curve: what one search knows for the next on the same rig."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core.checks import require_range
from markerseek.core.reading import MAX_INTENSITY, MIN_INTENSITY


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerCurve:
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

    fwhm_deg: float
    peak: float

    def __post_init__(self) -> None:
        require_range("marker curve: fwhm_deg", self.fwhm_deg, low=0.5, high=90.0, unit="deg")
        require_range("marker curve: peak", self.peak, low=MIN_INTENSITY, high=MAX_INTENSITY)
