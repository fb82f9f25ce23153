"""Samples gathered into a belief: the posterior of all of them, coarse over the range and fine where its mass is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from markerseek.core import Interval
from markerseek.core.reading import Sample
from markerseek.core.shapes import Float64
from markerseek.search.floor import Noise
from markerseek.search.posterior import arrival, middle
from markerseek.search.posterior.basis import CLEAR, Basis, all_told, basis_of
from markerseek.search.posterior.belief import Belief
from markerseek.search.posterior.grid import Grid, Heard
from markerseek.search.posterior.heard import place_ratio
from markerseek.search.posterior.narrow import Middle, narrowed
from markerseek.search.posterior.shapes import Shapes

BEYOND_STEPS = 12
"""Coarse steps that the grid goes on beyond each end of the range."""

BEYOND_SHARE = 0.05
"""Prior density there over that inside."""

COARSE_STEPS = 140
"""Coarse steps over the range: half a degree for ±35°."""

FINE_KNOTS = 17
"""Angles of a finer grid at which the moments of arrival are worked out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Moments:
    """Samples whose moments of arrival count; see `arrival.log_likelihood`."""

    heard_deg: Float64[np.ndarray, " samples"]
    moments_s: Float64[np.ndarray, "samples 2"]
    snr: Float64[np.ndarray, " samples"]

    def log_likelihood(
        self, angles_deg: Float64[np.ndarray, " angles"], *, knots: int
    ) -> Float64[np.ndarray, " angles"]:
        """At even angles, by way of so many that are worked out: it bends little over a degree."""
        every = np.linspace(angles_deg[0], angles_deg[-1], knots)
        told = arrival.log_likelihood(every, self.heard_deg, self.moments_s, self.snr)
        return np.asarray(np.interp(angles_deg, every, told))


class Evidence:
    """All samples of a search, and the coarse grid that grows with them.

    Parameters
    ----------
    limits
        Range of the search.
    shapes
        Family of curves.
    cues
        Which of "intensity", "arrival" and "lateral" count.
    """

    def __init__(self, *, limits: Interval, shapes: Shapes, cues: frozenset[str]) -> None:
        self._shapes = shapes
        self._cues = cues
        step_deg = limits.width_deg / COARSE_STEPS
        self._coarse_deg = limits.low_deg + step_deg * np.arange(-BEYOND_STEPS, COARSE_STEPS + BEYOND_STEPS + 1)
        inside = (self._coarse_deg >= limits.low_deg - step_deg / 2) & (
            self._coarse_deg <= limits.high_deg + step_deg / 2
        )
        self._log_prior = np.where(inside, 0.0, math.log(BEYOND_SHARE))
        self._grid: Grid | None = None
        self._basis = Basis(unit=0.0, sigma=1.0, marker_m=None, cells=1)
        self._heard: list[Heard] = []

    def belief(self, lit: Sequence[Sample], noise: Noise, *, particles: int) -> Belief:
        """Return the posterior of these samples, of which the earlier ones were seen before.

        Parameters
        ----------
        lit
            Samples with the laser on, at least one.
        noise
            Noise of the search.
        particles
            Markers to draw.
        """
        coarse = self._coarse(lit, noise)
        moments = self._moments(lit)
        prior = partial(self._else_known, moments=moments, knots=self._coarse_deg.size // 2 + 1)
        known = coarse.marginals(prior(self._coarse_deg), particles=particles)
        finer_prior = partial(self._else_known, moments=moments, knots=FINE_KNOTS)
        heard = self._heard if "intensity" in self._cues else []
        narrow = narrowed(self._shapes, coarse, known, heard, finer_prior, particles=particles)
        angle_deg, share = self._about_the_middle(lit, narrow, moments)
        basis = self._basis
        log_unit = math.log(basis.unit) - math.log(basis.sigma)
        return Belief(
            angle_deg=angle_deg,
            share=share,
            coarse_deg=self._coarse_deg,
            coarse_share=known.angle,
            theta_deg=narrow.markers.theta_deg,
            member=narrow.markers.member,
            log_snr=narrow.markers.log_amplitude + log_unit,
            loud_deg=np.array([heard.angle_deg for heard in narrow.loud]),
            loud_log_snr=np.array([heard.log_intensity for heard in narrow.loud]) + log_unit,
            fwhm_deg=narrow.fwhm_deg,
            marker_m=basis.marker_m,
            middle_sigma_deg=narrow.sigma_deg,
        )

    def _else_known(
        self, angles_deg: Float64[np.ndarray, " angles"], *, moments: _Moments | None, knots: int
    ) -> Float64[np.ndarray, " angles"]:
        """Ln of what is known of angles beside the intensities: the prior, and the moments of arrival."""
        log_angle = np.asarray(np.interp(angles_deg, self._coarse_deg, self._log_prior))
        if moments is not None:
            log_angle += moments.log_likelihood(angles_deg, knots=knots)
        return log_angle

    def _about_the_middle(
        self,
        lit: Sequence[Sample],
        narrow: Middle,
        moments: _Moments | None,
    ) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]]:
        """Angles of the marker and their probabilities, the middle of its curve being off; see `middle`."""
        angle_deg, share = narrow.angles_deg, narrow.share
        sigma_deg = math.hypot(middle.OFFSET_DEG, middle.OFFSET * narrow.fwhm_deg)
        step_deg = float(angle_deg[1] - angle_deg[0])
        if "intensity" not in self._cues or step_deg > sigma_deg:
            return angle_deg, share
        uneven = middle.uneven_share(lit, sigma=self._basis.sigma, marker_m=self._basis.marker_m)
        mean_deg = float(share @ angle_deg)
        half_deg = max(4.5 * sigma_deg, (angle_deg[-1] - angle_deg[0]) / 2)
        angles_deg = mean_deg + np.linspace(-half_deg, half_deg, 2 * math.ceil(half_deg / step_deg) + 1)
        told = np.zeros_like(angles_deg)
        if moments is not None:
            told = moments.log_likelihood(angles_deg, knots=2 * FINE_KNOTS)
            told -= told.max()
            share = share * np.exp(np.minimum(-np.interp(angle_deg, angles_deg, told), 30.0))
            share = share / share.sum()
        density = middle.offset(angle_deg, share, angles_deg, uneven=uneven, sigma_deg=sigma_deg)
        density *= np.exp(told)
        return angles_deg, density / density.sum()

    def _coarse(self, lit: Sequence[Sample], noise: Noise) -> Grid:
        """The coarse grid with all samples; made anew when what they are measured by has changed."""
        basis = basis_of(lit, noise)
        if self._grid is None or basis.differs(self._basis, told=all_told(lit)):
            self._basis = basis
            self._heard = []
            self._grid = Grid(
                shapes=self._shapes,
                angles_deg=self._coarse_deg,
                members=np.arange(0, self._shapes.fwhm_deg.size, 3),
                lowest=math.log(0.5),
                phases=15,
                amplitudes=18,
                blur=0.125,
            )
        for sample in lit[len(self._heard) :]:
            heard = self._terms(sample)
            self._heard.append(heard)
            if "intensity" in self._cues:
                self._grid.add(heard)
        return self._grid

    def _terms(self, sample: Sample) -> Heard:
        unit, sigma, marker_m = self._basis.unit, self._basis.sigma, self._basis.marker_m
        reading = sample.reading
        own = reading.noise_sigma if reading.noise_sigma is not None and reading.noise_sigma > 0 else sigma
        intensity = max(reading.intensity, 0.01 * own)
        ratio = place_ratio(reading.lateral_m, marker_m=marker_m) if "lateral" in self._cues else 1.0
        return Heard(
            angle_deg=sample.angle_deg,
            log_intensity=math.log(intensity) - math.log(unit),
            noise=own / intensity,
            cells=reading.cells or self._basis.cells,
            ratio=ratio,
        )

    def _moments(self, lit: Sequence[Sample]) -> _Moments | None:
        """Angles, moments and SNR of the samples whose arrival counts; None of fewer than two."""
        if "arrival" not in self._cues:
            return None
        sigma, marker_m = self._basis.sigma, self._basis.marker_m
        telling = [
            (sample.angle_deg, reading.centroid_s, reading.spread_s, reading.intensity / sigma)
            for sample in lit
            if (reading := sample.reading).centroid_s is not None
            and reading.spread_s is not None
            and reading.intensity > CLEAR * sigma
            and (
                marker_m is None or reading.lateral_m is None or abs(reading.lateral_m - marker_m) < middle.SAME_PLACE_M
            )
        ]
        if len(telling) < 2:
            return None
        told = np.array(telling, dtype=np.float64)
        return _Moments(heard_deg=told[:, 0], moments_s=told[:, 1:3], snr=told[:, 3])
