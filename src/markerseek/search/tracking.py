"""Follows a marker that moves, from frame to frame: particles of its motion and of its intensity curve.

One intensity says how far the marker is from the image plane, not on which side. A particle has an angle, a speed and
an acceleration of the marker, and a curve: height, width and form. The marker keeps its speed, or is accelerated for
about `TURN_S` seconds (a Markov chain of two states). That the curve is an unknown as well keeps the band honest: what
it is off by is the same in all frames of one flank, and no number of them averages it.
The energy from frame to frame is one of `ENERGY_ERRORS`, of which the frames say how probable each is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import PAPER_RANGE, Float64, Int64, Interval, SearchError, require_range
from markerseek.search.posterior.likelihood import (
    OUTLIER_RANGE,
    OUTLIER_SHARE,
    TABLE_LOW,
    TABLE_SIZE,
    TABLE_STEP,
    log_tables,
)

PARTICLES = 12_000
"""Particles, unless another number is given."""

LOST_SHARE = 0.5
"""The marker is lost where the standard deviation of its angle exceeds this share of the full width."""

LONGEST_STEP_S = 0.1
"""Longest time in which a marker keeps its acceleration; a longer one is taken in steps."""

BEGINS_PER_S, TURN_S = 0.5, 1.0
"""How often in a second an acceleration begins, and how long it lasts on average: it turns the marker round once."""

MOST_TIMES = 1.25
"""Largest acceleration over the one that is stated: each is uniform up to it, in either direction."""

WANDER = 0.05
"""Change of the speed beside that, in a second, over the acceleration that is stated."""

ENERGY_ERRORS: tuple[float, ...] = (0.03, 0.06, 0.1, 0.15)
"""Relative errors of a frame, equally probable at first: the laser's energy, and what no smooth curve has."""

FORMS: tuple[tuple[float, float], ...] = ((0.8, 2.0), (1.2, 2.4), (1.2, 5.0), (1.6, 2.0), (2.5, 2.0), (8.0, 2.0))
"""Tail p and knee q of (1) of `shapes`, equally probable; p = 8 is nearly the Gaussian."""

HEIGHT_ERROR, WIDTH_ERROR = 0.05, 0.05
"""Relative standard deviation of height and width of the curve that a search states."""

MISFIT, MISFIT_PACE, MISFIT_S = 0.5, 0.15, 0.25
"""Share of outliers among the last frames above which the marker is lost; most weight of a frame in it, and the time
over which fast frames are weighed, in seconds: a curve that is off is so in all frames of a flank."""

OWN_S = 0.025
"""Time from frame to frame, in seconds, from which a frame is evidence of its own. Of faster ones each counts by its
share of it: what the curve is off by is nearly the same in all of them."""

_DRIFT = 0.01
"""Change of ln height and ln width in the root of a second: laser and tissue, and it keeps the particles apart."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Markers:
    """Markers drawn from a posterior; each has a place in all arrays."""

    angle_deg: Float64[np.ndarray, " markers"]
    speed_deg_s: Float64[np.ndarray, " markers"]
    acceleration_deg_s2: Float64[np.ndarray, " markers"]
    height: Float64[np.ndarray, " markers"]
    """Over the peak that was stated."""
    width_deg: Float64[np.ndarray, " markers"]
    tail: Float64[np.ndarray, " markers"]
    knee: Float64[np.ndarray, " markers"]

    def curve(self, off_plane_deg: Float64[np.ndarray, "*times markers"]) -> Float64[np.ndarray, "*times markers"]:
        """Intensity of each over the peak that was stated, by (1) of `shapes`."""
        scaled = 2 * np.abs(off_plane_deg) / self.width_deg
        rise = 2 ** (self.knee / self.tail) - 1
        return np.asarray(self.height * (1 + rise * scaled**self.knee) ** (-self.tail / self.knee))


class Tracker:
    """Angle of a moving marker, from one intensity at a time, with the angle of the probe at each.

    Parameters
    ----------
    angle_deg, sigma_deg
        Angle that a search found, and its standard deviation, in degrees.
    fwhm_deg
        Full width of the intensity curve at half maximum, in degrees.
    peak
        Intensity with the probe on the marker.
    limits
        Angles between which the marker is.
    most_speed_deg_s
        Fastest marker that is followed, in degrees per second.
    acceleration_deg_s2
        Acceleration of a marker that turns round, in degrees per second squared.
    rng
        Draws the particles.
    particles
        How many there are.
    """

    def __init__(
        self,
        *,
        angle_deg: float,
        sigma_deg: float,
        fwhm_deg: float,
        peak: float,
        rng: np.random.Generator,
        limits: Interval = PAPER_RANGE,
        most_speed_deg_s: float = 15.0,
        acceleration_deg_s2: float = 20.0,
        particles: int = PARTICLES,
    ) -> None:
        require_range("tracker: angle_deg", angle_deg, low=limits.low_deg, high=limits.high_deg, unit="deg")
        for name, value, most, unit in (
            ("sigma_deg", sigma_deg, 10.0, "deg"),
            ("fwhm_deg", fwhm_deg, 60.0, "deg"),
            ("peak", peak, math.inf, ""),
            ("most_speed_deg_s", most_speed_deg_s, 100.0, "deg/s"),
            ("acceleration_deg_s2", acceleration_deg_s2, 1000.0, "deg/s²"),
        ):
            require_range(f"tracker: {name}", value, low=0, high=most, unit=unit, open_low=True)
        self.fwhm_deg, self.peak = fwhm_deg, peak
        self.limits = limits
        self.most_speed_deg_s, self.acceleration_deg_s2 = most_speed_deg_s, acceleration_deg_s2
        self._rng = rng
        self._angle_deg = np.clip(rng.normal(angle_deg, sigma_deg, particles), limits.low_deg, limits.high_deg)
        # Nothing is known of the speed but that it is below the largest.
        self._speed_deg_s = rng.uniform(-most_speed_deg_s, most_speed_deg_s, particles)
        self._acceleration = np.zeros(particles)
        self._tail, self._knee = np.array(FORMS)[rng.integers(len(FORMS), size=particles)].T
        self._log_height = rng.normal(0.0, HEIGHT_ERROR, particles)
        self._log_width = rng.normal(0.0, WIDTH_ERROR, particles)
        self._weight = np.full(particles, 1 / particles)
        self._misfit = 0.0
        self._error_share = np.full(len(ENERGY_ERRORS), 1 / len(ENERGY_ERRORS))

    @property
    def mean_deg(self) -> float:
        """Mean of the angle at the time of the last frame, in degrees."""
        return float(self._weight @ self._angle_deg)

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of that angle, in degrees."""
        return math.sqrt(float(self._weight @ (self._angle_deg - self.mean_deg) ** 2))

    @property
    def speed_deg_s(self) -> float:
        """Mean of the speed, in degrees per second."""
        return float(self._weight @ self._speed_deg_s)

    @property
    def lost(self) -> bool:
        """Whether the angle is so uncertain that the marker must be searched for."""
        # So that NaN is lost.
        return not self.sigma_deg <= LOST_SHARE * self.fwhm_deg

    @property
    def energy_error(self) -> float:
        """Relative error of a frame, as far as the frames say."""
        return float(self._error_share @ np.array(ENERGY_ERRORS))

    def expected_deg(self, after_s: float) -> float:
        """Mean of the angle so long after the last frame if the speed stays, in degrees."""
        _require_after(after_s)
        limits = self.limits
        ahead_deg = np.clip(self._angle_deg + self._speed_deg_s * after_s, limits.low_deg, limits.high_deg)
        # The weights add up to 1 but for their rounding.
        return limits.nearest(float(self._weight @ ahead_deg))

    def drawn(self, number: int) -> Markers:
        """So many markers, as the posterior has them."""
        chosen = self._chosen((np.arange(number) + 0.5) / number)
        return Markers(
            angle_deg=self._angle_deg[chosen],
            speed_deg_s=self._speed_deg_s[chosen],
            acceleration_deg_s2=self._acceleration[chosen],
            height=np.exp(self._log_height[chosen]),
            width_deg=self.fwhm_deg * np.exp(self._log_width[chosen]),
            tail=self._tail[chosen],
            knee=self._knee[chosen],
        )

    def tell(self, angle_deg: float, intensity: float, *, after_s: float, noise_sigma: float, cells: int) -> None:
        """Take the intensity of the next frame.

        Parameters
        ----------
        angle_deg
            Angle of the probe when it was taken, in degrees.
        intensity
            What was measured there.
        after_s
            Time since the frame before, in seconds.
        noise_sigma
            Standard deviation of the noise of this frame, in the intensity's unit.
        cells
            Independent cells of noise of which the intensity is the largest, if it is not the marker's.

        Raises
        ------
        SearchError
            If the intensity is not a finite number of at least 0, the noise none above 0, or there is no cell.
        """
        if not 0 <= intensity < math.inf or not math.isfinite(angle_deg):
            raise SearchError(f"tracker: intensity {intensity} at {angle_deg} deg; it must be finite and at least 0")
        if not 0 < noise_sigma < math.inf or not cells >= 1:
            raise SearchError(
                f"tracker: noise_sigma {noise_sigma} of {cells} cells; it must be finite and above 0, of at least "
                "1 cell"
            )
        _require_after(after_s)
        steps = math.ceil(after_s / LONGEST_STEP_S - 1e-9)
        for _ in range(steps):
            self._move(after_s / steps)
        floored = max(intensity, 0.01 * noise_sigma)
        tables = log_tables(noise=noise_sigma / floored, cells=cells, errors=ENERGY_ERRORS)
        place = (self._log_curve(angle_deg) + math.log(self.peak / floored) - TABLE_LOW) / TABLE_STEP
        place = np.clip(place, 0.0, TABLE_SIZE - 1.001)
        below = place.astype(int)
        share = place - below
        own = min(1.0, after_s / OWN_S)
        likelihoods = np.exp(own * (tables[:, below] * (1 - share) + tables[:, below + 1] * share))
        evidence = likelihoods @ self._weight
        weight = self._weight * (self._error_share @ likelihoods)
        self._weight = weight / weight.sum()
        fits = float(self._error_share @ evidence)
        self._error_share = self._error_share * evidence / fits
        pace = min(MISFIT_PACE, -math.expm1(-after_s / MISFIT_S))
        self._misfit += pace * ((OUTLIER_SHARE / OUTLIER_RANGE) ** own / fits - self._misfit)
        if self._misfit > MISFIT:
            self._forget()
        if 1 / float(self._weight @ self._weight) < self._weight.size / 2:
            self._resample()

    def _forget(self) -> None:
        """Spread the particles over the range: the marker is not where they are. The curve is kept."""
        number = self._weight.size
        self._angle_deg = self._rng.uniform(self.limits.low_deg, self.limits.high_deg, number)
        self._speed_deg_s = self._rng.uniform(-self.most_speed_deg_s, self.most_speed_deg_s, number)
        self._acceleration = np.zeros(number)
        self._weight = np.full(number, 1 / number)
        self._misfit = 0.0

    def _log_curve(self, probe_deg: float) -> Float64[np.ndarray, " particles"]:
        """Ln of (1) of `shapes` for each particle, relative to the peak that was stated."""
        width_deg = self.fwhm_deg * np.exp(self._log_width)
        scaled = 2 * np.abs(probe_deg - self._angle_deg) / width_deg
        rise = 2 ** (self._knee / self._tail) - 1
        return np.asarray(self._log_height - self._tail / self._knee * np.log1p(rise * scaled**self._knee))

    def _move(self, after_s: float) -> None:
        """Move each marker on, and let its acceleration begin or end."""
        rng, number = self._rng, self._weight.size
        draw = rng.random(number)
        still = self._acceleration == 0
        ends = ~still & (draw < -math.expm1(-after_s / TURN_S))
        begins = still & (draw < -math.expm1(-after_s * BEGINS_PER_S))
        most = MOST_TIMES * self.acceleration_deg_s2
        self._acceleration[ends] = 0.0
        self._acceleration[begins] = rng.uniform(-most, most, int(begins.sum()))
        self._speed_deg_s += rng.normal(0, WANDER * self.acceleration_deg_s2 * math.sqrt(after_s), number)
        former = self._speed_deg_s
        self._speed_deg_s = former + self._acceleration * after_s
        beyond = np.abs(self._speed_deg_s) > self.most_speed_deg_s
        self._acceleration[beyond] = 0.0
        self._speed_deg_s = np.clip(self._speed_deg_s, -self.most_speed_deg_s, self.most_speed_deg_s)
        self._angle_deg = self._angle_deg + (former + self._speed_deg_s) / 2 * after_s
        # At an end of the range a marker can only come back.
        outside = (self._angle_deg < self.limits.low_deg) | (self._angle_deg > self.limits.high_deg)
        self._angle_deg = np.clip(self._angle_deg, self.limits.low_deg, self.limits.high_deg)
        self._speed_deg_s[outside] *= -1
        drift = _DRIFT * math.sqrt(after_s)
        for values, deviation in ((self._log_height, HEIGHT_ERROR), (self._log_width, WIDTH_ERROR)):
            # Towards what the search stated, so that it stays as far from it as that may be off.
            step = drift * rng.standard_normal(number) - values * drift**2 / (2 * deviation**2)
            np.add(values, step, out=values)

    def _resample(self) -> None:
        """Resample the particles by their weights, systematically (Kitagawa 1996)."""
        number = self._weight.size
        chosen = self._chosen((np.arange(number) + self._rng.random()) / number)
        for name in ("_angle_deg", "_speed_deg_s", "_acceleration", "_tail", "_knee", "_log_height", "_log_width"):
            setattr(self, name, getattr(self, name)[chosen])
        self._weight = np.full(number, 1 / number)

    def _chosen(self, shares: Float64[np.ndarray, " drawn"]) -> Int64[np.ndarray, " drawn"]:
        """Numbers of the particles at these shares of the weight, in the order of their angles."""
        order = np.argsort(self._angle_deg)
        total = np.cumsum(self._weight[order])
        return np.asarray(order[np.minimum(np.searchsorted(total, shares * total[-1]), order.size - 1)])


def _require_after(after_s: float) -> None:
    require_range("tracker: after_s", after_s, low=0, high=60, unit="s", open_low=True)
