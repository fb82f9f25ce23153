"""Intensity curves with their slope, as the bounds need them: in closed form, or through computed points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from markerseek.core import ConfigError
from markerseek.core.shapes import Float64


class SlopedCurve(Protocol):
    """Noise-free intensity over the angle t off the marker, 1 at t = 0."""

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TailedCurve:
    """S(t) = (1 + (2^(q/p) − 1)·(2|t|/F)^q)^(−p/q), or the Gaussian 2^(−(2t/F)²) where p is infinite.

    Attributes
    ----------
    fwhm_deg
        Full width at half maximum F in degrees.
    tail
        Exponent p of the tails, which fall as 1/|t|^p.
    knee
        Sharpness q of the knee, above 1.
    """

    fwhm_deg: float
    tail: float = math.inf
    knee: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.fwhm_deg < math.inf:
            raise ConfigError(f"curve: fwhm_deg is {self.fwhm_deg} deg, it must be positive and finite")
        if not (self.tail > 0 and 1 < self.knee < math.inf):
            raise ConfigError(f"curve: tail {self.tail} and knee {self.knee}: they must exceed 0 and 1")

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""
        scaled = 2 * np.abs(off_deg) / self.fwhm_deg
        if math.isinf(self.tail):
            return np.asarray(np.exp2(-(scaled**2)))
        return np.asarray((1 + (2 ** (self.knee / self.tail) - 1) * scaled**self.knee) ** (-self.tail / self.knee))

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""
        scaled = 2 * np.abs(off_deg) / self.fwhm_deg
        inner = np.sign(off_deg) * 2 / self.fwhm_deg
        if math.isinf(self.tail):
            return np.asarray(-2 * math.log(2) * scaled * inner * np.exp2(-(scaled**2)))
        strength = 2 ** (self.knee / self.tail) - 1
        base = 1 + strength * scaled**self.knee
        return np.asarray(
            -self.tail * strength * scaled ** (self.knee - 1) * inner * base ** (-self.tail / self.knee - 1)
        )


class SampledCurve:
    """A curve through computed points of one side, alike on both: monotone cubic pieces (PCHIP) and their derivative.

    Beyond the last point it stays as it is there.

    Parameters
    ----------
    off_deg
        Angles t from 0 upwards, rising, in degrees.
    height
        S there, positive, shape (points,).
    """

    def __init__(self, off_deg: Float64[np.ndarray, " points"], height: Float64[np.ndarray, " points"]) -> None:
        if off_deg.size < 3 or off_deg[0] != 0 or not np.all(np.diff(off_deg) > 0):
            raise ConfigError("sampled curve: off_deg must begin at 0 and rise, with at least three angles")
        if height.shape != off_deg.shape or not np.all((height > 0) & np.isfinite(height)):
            raise ConfigError("sampled curve: height must hold one positive finite number for each angle")
        # Imported here: it takes a third of a second, which a search would pay for nothing.
        from scipy.interpolate import PchipInterpolator

        mirrored = np.concatenate([-off_deg[:0:-1], off_deg])
        self._last_deg = float(off_deg[-1])
        self._value = PchipInterpolator(mirrored, np.concatenate([height[:0:-1], height]) / height[0])
        self._slope = self._value.derivative()

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""
        return np.asarray(self._value(np.clip(off_deg, -self._last_deg, self._last_deg)))

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""
        inside = np.abs(off_deg) <= self._last_deg
        return np.asarray(np.where(inside, self._slope(np.clip(off_deg, -self._last_deg, self._last_deg)), 0.0))
