"""Follows a marker that moves: a posterior over its angle and speed, with motion noise, from frame to frame.

One intensity says how far the marker is from the image plane, not on which side. So the probe looks at the two flanks
of the curve in turn, ahead of and behind the angle where the marker is expected at the time of the next frame. The
curve's height and width are those that a search found before.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import PAPER_RANGE, Float64, Interval, SearchError, require_range

FLANK_SHARE = 0.3
"""How far beside the expected angle the probe looks, as a share of the curve's full width at half maximum."""

SHAPE_ERROR = 0.1
"""Relative standard deviation of an intensity about the assumed curve: shape, energy of the laser, tissue."""

LOST_SHARE = 0.5
"""The marker is lost where the standard deviation of its angle exceeds this share of the full width."""

_OUTLIERS = 1e-3
_TAIL, _KNEE = 1.2, 2.4
_STEP_DEG = 0.1
_SPEEDS = 25


class Tracker:
    """Angle of a moving marker, from one intensity at a time.

    Parameters
    ----------
    angle_deg, sigma_deg
        Angle that a search found, and its standard deviation, in degrees.
    fwhm_deg
        Full width of the intensity curve at half maximum, in degrees.
    peak
        Intensity with the probe on the marker.
    noise_sigma
        Standard deviation of the noise, in the same unit.
    limits
        Angles that may be asked for.
    most_speed_deg_s
        Fastest marker that is followed, in degrees per second.
    acceleration_deg_s2
        Motion noise: standard deviation of the marker's acceleration, in degrees per second squared.
    """

    def __init__(
        self,
        *,
        angle_deg: float,
        sigma_deg: float,
        fwhm_deg: float,
        peak: float,
        noise_sigma: float,
        limits: Interval = PAPER_RANGE,
        most_speed_deg_s: float = 15.0,
        acceleration_deg_s2: float = 20.0,
    ) -> None:
        require_range("tracker: angle_deg", angle_deg, low=limits.low_deg, high=limits.high_deg, unit="deg")
        for name, value, most, unit in (
            ("sigma_deg", sigma_deg, 10.0, "deg"),
            ("fwhm_deg", fwhm_deg, 60.0, "deg"),
            ("peak", peak, math.inf, ""),
            ("noise_sigma", noise_sigma, peak, ""),
            ("most_speed_deg_s", most_speed_deg_s, 100.0, "deg/s"),
            ("acceleration_deg_s2", acceleration_deg_s2, 1000.0, "deg/s²"),
        ):
            require_range(f"tracker: {name}", value, low=0, high=most, unit=unit, open_low=True)
        self._limits = limits
        self._fwhm_deg, self._peak, self._noise_sigma = fwhm_deg, peak, noise_sigma
        self._acceleration = acceleration_deg_s2
        self._angle_deg = np.arange(limits.low_deg, limits.high_deg + _STEP_DEG / 2, _STEP_DEG)
        self._speed_deg_s = np.linspace(-most_speed_deg_s, most_speed_deg_s, _SPEEDS)
        # Nothing is known of the speed but that it is below the largest.
        around = np.exp(-0.5 * ((self._angle_deg - angle_deg) / max(sigma_deg, _STEP_DEG)) ** 2)
        self._probability = np.tile(around / around.sum() / _SPEEDS, (_SPEEDS, 1))
        self._side = 1.0
        self._next: tuple[float, Float64[np.ndarray, "speeds angles"]] | None = None

    @property
    def mean_deg(self) -> float:
        """Mean of the angle at the time of the last frame, in degrees."""
        return float(self._probability.sum(axis=0) @ self._angle_deg)

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of that angle, in degrees."""
        share = self._probability.sum(axis=0)
        return math.sqrt(float(share @ (self._angle_deg - self.mean_deg) ** 2))

    @property
    def speed_deg_s(self) -> float:
        """Mean of the speed, in degrees per second."""
        return float(self._probability.sum(axis=1) @ self._speed_deg_s)

    @property
    def lost(self) -> bool:
        """Whether the angle is so uncertain that a new search is needed."""
        # So that NaN is lost.
        return not self.sigma_deg <= LOST_SHARE * self._fwhm_deg

    def ask(self, after_s: float) -> float:
        """Angle in degrees at which the next frame should be taken.

        Parameters
        ----------
        after_s
            Time from the last frame to the next, in seconds.
        """
        expected_deg = float(self._moved(after_s).sum(axis=0) @ self._angle_deg)
        beside_deg = self._side * FLANK_SHARE * self._fwhm_deg
        # At an end of the range only one of the flanks can be looked at.
        if expected_deg + beside_deg not in self._limits:
            beside_deg = -beside_deg
        return self._limits.nearest(expected_deg + beside_deg)

    def tell(self, angle_deg: float, intensity: float, *, after_s: float) -> None:
        """Take the intensity of the next frame.

        Parameters
        ----------
        angle_deg
            Angle of the probe, as read back, in degrees.
        intensity
            What was measured there.
        after_s
            Time since the frame before, in seconds.

        Raises
        ------
        SearchError
            If the intensity is not a finite number of at least 0.
        """
        if not 0 <= intensity < math.inf or not math.isfinite(angle_deg):
            raise SearchError(f"tracker: intensity {intensity} at {angle_deg} deg; it must be finite and at least 0")
        moved = self._moved(after_s)
        expected = self._peak * curve(angle_deg - self._angle_deg, fwhm_deg=self._fwhm_deg)
        sigma = np.hypot(self._noise_sigma, SHAPE_ERROR * expected)
        likelihood = np.exp(-0.5 * ((intensity - expected) / sigma) ** 2) * self._noise_sigma / sigma
        # A frame that fits nowhere, as one with a burst of noise, must not end the track.
        weighed = moved * ((1 - _OUTLIERS) * likelihood + _OUTLIERS)
        self._probability = weighed / weighed.sum()
        self._side, self._next = -self._side, None

    def _moved(self, after_s: float) -> Float64[np.ndarray, "speeds angles"]:
        """The posterior after some time: each speed moves its angles, and the acceleration spreads both."""
        require_range("tracker: after_s", after_s, low=0, high=60, unit="s", open_low=True)
        # Needed before and after each frame, mostly for the same time.
        if self._next is not None and self._next[0] == after_s:
            return self._next[1]
        spread_deg_s = self._acceleration * after_s
        step = self._speed_deg_s[1] - self._speed_deg_s[0]
        kernel = np.exp(-0.5 * ((self._speed_deg_s[:, None] - self._speed_deg_s) / max(spread_deg_s, step / 2)) ** 2)
        faster = (kernel / kernel.sum(axis=0)) @ self._probability
        moved = np.array(
            [
                np.interp(self._angle_deg - speed * after_s, self._angle_deg, row, left=0.0, right=0.0)
                for speed, row in zip(self._speed_deg_s, faster, strict=True)
            ]
        )
        total = float(moved.sum())
        # All of it may have left the range; then it is anywhere.
        moved = moved / total if total > 0 else np.full_like(moved, 1 / moved.size)
        self._next = (after_s, moved)
        return moved


def curve(off_plane_deg: Float64[np.ndarray, " angles"], *, fwhm_deg: float) -> Float64[np.ndarray, " angles"]:
    """Intensity over the angle off the plane, relative to its peak; the most common curve of the posterior's family.

    S = (1 + (2^(q/p) − 1)·(2|t|/F)^q)^(−p/q), with tails as 1/|t|^p (p = 1.2) and a knee of q = 2.4.

    ``fwhm_deg``: full width F at half maximum.
    """
    ratio = _KNEE / _TAIL
    return np.asarray((1 + (2**ratio - 1) * np.abs(2 * off_plane_deg / fwhm_deg) ** _KNEE) ** (-1 / ratio))
