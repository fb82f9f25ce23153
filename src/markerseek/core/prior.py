"""What is known of a marker's intensity curve before a search: that of the last marker on the same rig."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core.checks import require_range
from markerseek.core.reading import LEAST_INTENSITY, MOST_INTENSITY


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerPrior:
    """Width and height of the intensity curve of a former marker on this rig.

    Attributes
    ----------
    fwhm_deg
        Full width at half maximum of its curve, in degrees.
    peak
        Intensity with the probe on it, in the unit of the frames.

    Raises
    ------
    ConfigError
        If a number is not finite, or out of range.
    """

    fwhm_deg: float
    peak: float

    def __post_init__(self) -> None:
        require_range("prior: fwhm_deg", self.fwhm_deg, low=0.5, high=90.0, unit="deg")
        require_range("prior: peak", self.peak, low=LEAST_INTENSITY, high=MOST_INTENSITY)
