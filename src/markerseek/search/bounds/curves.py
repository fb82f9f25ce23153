"""Intensity curves with their derivative, as the bounds need them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from markerseek.core import ConfigError, Float64


@runtime_checkable
class SlopedCurve(Protocol):
    """Noise-free intensity S over the angle t off the marker, 1 at t = 0."""

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""


class SampledCurve:
    """A symmetric curve through computed points of one side: monotone cubic interpolation (PCHIP).

    Beyond the last point the curve is constant.

    Parameters
    ----------
    off_deg
        Angles t from 0 upwards, rising, in degrees.
    height
        S at these angles, positive, shape (points,).
    """

    def __init__(self, off_deg: Float64[np.ndarray, " points"], height: Float64[np.ndarray, " points"]) -> None:
        if off_deg.size < 3 or off_deg[0] != 0 or not np.all(np.diff(off_deg) > 0):
            raise ConfigError("sampled curve: off_deg must begin at 0 and rise, with at least three angles")
        if height.shape != off_deg.shape or not np.all((height > 0) & np.isfinite(height)):
            raise ConfigError("sampled curve: height must hold one positive finite number for each angle")
        # Imported here because it takes a third of a second, and searches do not need it.
        from scipy.interpolate import PchipInterpolator

        mirrored = np.concatenate([-off_deg[:0:-1], off_deg])
        self._last_deg = float(off_deg[-1])
        # Monotone pieces: a cubic spline would overshoot beside the peak, and the bound would use slopes that
        # the curve does not have.
        self._value = PchipInterpolator(mirrored, np.concatenate([height[:0:-1], height]) / height[0])
        self._slope = self._value.derivative()

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""
        return np.asarray(self._value(np.clip(off_deg, -self._last_deg, self._last_deg)))

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""
        inside = np.abs(off_deg) <= self._last_deg
        return np.asarray(np.where(inside, self._slope(np.clip(off_deg, -self._last_deg, self._last_deg)), 0.0))
