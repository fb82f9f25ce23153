"""Noise-free intensity curves S(t): the peak of the image t degrees off the marker, relative to that at t = 0.

A curve gives the heights of the separate peaks of the envelope image, strongest first: a long laser pulse and the edges
of an element leave several of nearly the same height (physics notes), and under noise any of them may be the largest.
The closed forms have one peak. The recorded form interpolates heights that were computed or measured on a grid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from markerseek.core import ConfigError, Float64, require_range


class IntensityCurve(Protocol):
    """Intensity over the angle off the marker, without noise."""

    def peaks(self, off_plane_deg: float) -> Sequence[float]:
        """Heights of the separate peaks of the image, relative to the largest with the probe on the marker."""


WIDTH_DEG = (1e-6, 1e6)
"""Narrowest and widest curve, full width at half maximum in degrees."""

MAX_POWER = 20.0
"""Steepest power of a curve's tails, with which the narrowest one does not overflow."""

_STEP_DEG = 0.02
"""Step of the fine grid of a recorded curve, in degrees."""


def _check_width(fwhm_deg: float) -> None:
    low, high = WIDTH_DEG
    require_range("curve: fwhm_deg", fwhm_deg, low=low, high=high, unit="deg", cure="2 to 35 deg are usual")


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianCurve:
    """exp(−4 ln 2·(t/w)²): its tails vanish, which those of a wideband pulse do not."""

    fwhm_deg: float
    """Full width w at half maximum."""

    def __post_init__(self) -> None:
        _check_width(self.fwhm_deg)

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """One peak; see the class."""
        return (math.exp(-4 * math.log(2) * (off_plane_deg / self.fwhm_deg) ** 2),)


@dataclass(frozen=True, slots=True, kw_only=True)
class SechCurve:
    """1/cosh(2 arcosh(2)·t/w): exponential tails."""

    fwhm_deg: float
    """Full width w at half maximum."""

    def __post_init__(self) -> None:
        _check_width(self.fwhm_deg)

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """One peak; see the class."""
        # Beyond 700 the hyperbolic cosine leaves the range of a double, and its inverse is 0 in any case
        return (1 / math.cosh(min(700.0, 2 * math.acosh(2) * abs(off_plane_deg) / self.fwhm_deg)),)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCurve:
    """1/(1 + (2|t|/w)^k): tails as 1/|t|^k, like the edge waves of an element for k near 1."""

    fwhm_deg: float
    """Full width w at half maximum."""
    power: float = 2.0
    """Exponent k of the tails; 2 is the Lorentz curve."""

    def __post_init__(self) -> None:
        _check_width(self.fwhm_deg)
        require_range("curve: power", self.power, low=0, high=MAX_POWER, open_low=True, cure="1 to 2 are usual")

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """One peak; see the class."""
        return (1 / (1 + (2 * abs(off_plane_deg) / self.fwhm_deg) ** self.power),)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoHumps:
    """Curve of two sources at different positions in the image, with a peak for each."""

    curve: IntensityCurve
    """Curve of the marker, and of the other source."""
    apart_deg: float
    """Angle of the other source less that of the marker."""
    relative: float
    """Its height over the marker's."""

    def __post_init__(self) -> None:
        require_range("two humps: apart_deg", self.apart_deg, low=-180.0, high=180.0, unit="deg")
        require_range("two humps: relative", self.relative, low=0.0, high=1.0)

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """Peaks of the marker, then those of the other source."""
        other = self.curve.peaks(off_plane_deg - self.apart_deg)
        return (*self.curve.peaks(off_plane_deg), *(self.relative * height for height in other))


class RecordedCurve:
    """A curve between recorded angles: monotone cubic pieces (PCHIP) tabulated on a fine grid, linear in between.

    Beyond the recorded angles the outermost heights hold.

    ``off_plane_deg``: angles off the marker, ascending. ``heights``: heights of the peaks at each, strongest first, not
    negative.
    """

    def __init__(
        self,
        off_plane_deg: Float64[np.ndarray, " angles"],
        heights: Float64[np.ndarray, "angles peaks"],
    ) -> None:
        if off_plane_deg.size < 2 or not np.all(np.diff(off_plane_deg) > 0):
            raise ConfigError("recorded curve: off_plane_deg must hold at least two angles, each above the one before")
        if heights.shape[:1] != off_plane_deg.shape or heights.ndim != 2:
            raise ConfigError(f"recorded curve: heights have the shape {heights.shape}, (angles, peaks) is needed")
        if not np.all((heights >= 0) & np.isfinite(heights)):
            raise ConfigError("recorded curve: heights must be finite and not negative")
        count = max(2, math.ceil((off_plane_deg[-1] - off_plane_deg[0]) / _STEP_DEG) + 1)
        fine = np.linspace(off_plane_deg[0], off_plane_deg[-1], count)
        self._low_deg = float(fine[0])
        self._per_deg = (count - 1) / float(fine[-1] - fine[0])
        self._last = count - 1
        # Imported here: it takes a third of a second, and a search on frames does not need it.
        from scipy.interpolate import PchipInterpolator

        # Lists of floats: a lookup of one angle is four times as fast as in an array.
        self._rows: list[list[float]] = np.maximum(PchipInterpolator(off_plane_deg, heights)(fine), 0).tolist()

    def peaks(self, off_plane_deg: float) -> list[float]:
        """Heights at an angle off the marker in degrees."""
        place = min(max((off_plane_deg - self._low_deg) * self._per_deg, 0.0), float(self._last))
        left = min(int(place), self._last - 1)
        share = place - left
        return [(1 - share) * a + share * b for a, b in zip(self._rows[left], self._rows[left + 1], strict=True)]
