"""From samples to the posterior of the angle: coarse grid, finer grids, symmetric likelihood, asymmetry.

1. A coarse grid over the whole range takes each observation once.
2. Finer grids follow the posterior down where it is narrow.
3. Once three samples are strong, the likelihood of a symmetric curve (7) replaces the grid's, about the grid's mean.
4. The posterior of the curve's centre is widened by the shift of asymmetric markers (10).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from markerseek.core import Float64, Int64, Interval, MarkerCurve, Sample
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.angle_posterior import AnglePosterior, mean_and_sigma
from markerseek.search.posterior.arrival import ArrivalMoments, moments_of
from markerseek.search.posterior.asymmetry import (
    asymmetry_probability,
    mean_coherence,
    radius_m,
    shift_scale_m,
    shifted_density,
)
from markerseek.search.posterior.grid import Grid, Marginals, Particles, finer
from markerseek.search.posterior.likelihood import Observation, Scale, scale_of
from markerseek.search.posterior.prior import loudness_of, shapes_with
from markerseek.search.posterior.shapes import Shapes
from markerseek.search.posterior.symmetry import (
    LEAST_STRONG,
    hypotheses_of,
    strong_observations,
    symmetric_log_likelihood,
)

BEYOND_STEPS = 12
"""Coarse steps by which the grid extends beyond each end of the range."""

BEYOND_SHARE = 0.05
"""Prior density there over that inside."""

COARSE_STEPS = 140
"""Coarse steps over the range: half a degree for ±35°."""

FINE_ANGLES = 33
"""Angles of a finer grid."""

FINE_KNOTS = 17
"""Angles of a finer grid at which the likelihood of the moments of arrival is computed."""

SYMMETRY_ANGLES = (13, 25)
"""Angles at which the symmetric likelihood is computed: at first, and about the mean of that."""

SYMMETRY_STEP, MOST_SYMMETRY_ANGLES = 0.02, 151
"""Their step over the full width at half maximum where they are spread wider than that, and their largest number."""

SYMMETRY_SHAPES = 8
"""Shapes with which it is computed, the most probable."""

LEAST_SHARE = 0.01
"""Probability of a hypothesis, over that of the most probable, below which it is dropped in between."""

SHIFT_SCALES = 6.0
"""Reach of the marker's angles to either side, in scales of the shift: 99.6 % of its distribution."""

HALF_WIDTH_SIGMAS = 5.0
"""Half the width of the next finer grid, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centre:
    """The posterior of the centre of the curve.

    Attributes
    ----------
    angles_deg, share
        Angles in degrees, evenly spaced, and the probability of each; they add up to 1.
    particles
        Markers drawn from it.
    fwhm_deg
        Mean of the curve's full width at half maximum, in degrees.
    strong
        Observations to which a symmetric curve was fitted; none if too few are strong.
    """

    angles_deg: Float64[np.ndarray, " angles"]
    share: Float64[np.ndarray, " angles"]
    particles: Particles
    fwhm_deg: float
    strong: Sequence[Observation]


class Inference:
    """The posterior of one search, with the coarse grid that grows with its samples.

    Parameters
    ----------
    limits
        Range of the search.
    shapes
        Family of curves.
    cues
        Which of "intensity", "arrival" and "lateral" count.
    prior
        What is known of the curve before the first sample; None: what the physics table says.
    """

    def __init__(
        self, *, limits: Interval, shapes: Shapes, cues: frozenset[str], prior: MarkerCurve | None = None
    ) -> None:
        self._shapes = shapes if prior is None else shapes_with(shapes, prior)
        self._prior = prior
        self._cues = cues
        step_deg = limits.width_deg / COARSE_STEPS
        self._coarse_deg = limits.low_deg + step_deg * np.arange(-BEYOND_STEPS, COARSE_STEPS + BEYOND_STEPS + 1)
        inside = (self._coarse_deg >= limits.low_deg - step_deg / 2) & (
            self._coarse_deg <= limits.high_deg + step_deg / 2
        )
        # Uniform inside, and a little beyond: without it a marker beyond an end would seem certain to be at that end.
        self._log_prior = np.where(inside, 0.0, math.log(BEYOND_SHARE))
        self._grid: Grid | None = None
        self._scale = Scale(unit=0.0, sigma=1.0, marker_m=None, cells=1)
        self._observations: list[Observation] = []
        self._added: list[tuple[float, float, int | None]] = []

    def posterior(self, lit: Sequence[Sample], noise: SearchNoise, *, particles: int) -> AnglePosterior:
        """Return the posterior of all samples, of which only the new ones are added to the coarse grid.

        The grid is computed again where an earlier sample reads otherwise than before, for it was taken of a place that
        is known better now.

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
        moments = moments_of(lit, self._scale) if "arrival" in self._cues else None
        prior = partial(self._log_prior_and_moments, moments=moments, knots=self._coarse_deg.size // 2 + 1)
        known = coarse.marginals(prior(self._coarse_deg), particles=particles)
        finer_prior = partial(self._log_prior_and_moments, moments=moments, knots=FINE_KNOTS)
        observations = self._observations if "intensity" in self._cues else []
        centre = refine(self._shapes, coarse, known, observations, finer_prior, particles=particles)
        angle_deg, share = self._with_asymmetry(lit, centre, moments)
        scale = self._scale
        log_unit = math.log(scale.unit) - math.log(scale.sigma)
        return AnglePosterior(
            angle_deg=angle_deg,
            share=share,
            coarse_deg=self._coarse_deg,
            coarse_share=known.angle,
            sigma=scale.sigma,
            theta_deg=centre.particles.theta_deg,
            member=centre.particles.member,
            log_snr=centre.particles.log_amplitude + log_unit,
            strong_deg=np.array([each.angle_deg for each in centre.strong]),
            strong_log_snr=np.array([each.log_intensity for each in centre.strong]) + log_unit,
            fwhm_deg=centre.fwhm_deg,
            marker_m=scale.marker_m,
            centre_sigma_deg=mean_and_sigma(centre.angles_deg, centre.share)[1],
        )

    def _coarse(self, lit: Sequence[Sample], noise: SearchNoise) -> Grid:
        """The coarse grid with all samples; computed again when their scale has changed."""
        scale = scale_of(lit, noise)
        stated = all(sample.reading.noise_sigma is not None and sample.reading.cells is not None for sample in lit)
        known = [(sample.angle_deg, sample.reading.intensity, sample.reading.cells) for sample in lit]
        same = known[: len(self._added)] == self._added
        self._added = known
        if self._grid is None or not same or scale.replaces(self._scale, stated=stated):
            self._scale = scale
            self._observations = []
            self._grid = Grid(
                shapes=self._shapes,
                angles_deg=self._coarse_deg,
                # Every third shape: neighbouring widths differ by 10 % and are hard to tell apart.
                members=np.arange(0, self._shapes.fwhm_deg.size, 3),
                lowest=math.log(0.5),
                phases=15,
                amplitudes=18,
                blur=0.125,
                loudness=None if self._prior is None else loudness_of(self._prior, unit=self._scale.unit),
            )
        for sample in lit[len(self._observations) :]:
            observation = self._scale.observation(sample, use_lateral="lateral" in self._cues)
            self._observations.append(observation)
            if "intensity" in self._cues:
                self._grid.add(observation)
        return self._grid

    def _log_prior_and_moments(
        self, angles_deg: Float64[np.ndarray, " angles"], *, moments: ArrivalMoments | None, knots: int
    ) -> Float64[np.ndarray, " angles"]:
        """Ln of the angle's prior times the likelihood of the moments of arrival."""
        log_angle = np.asarray(np.interp(angles_deg, self._coarse_deg, self._log_prior))
        if moments is not None:
            log_angle += moments.log_likelihood(angles_deg, knots=knots)
        return log_angle

    def _with_asymmetry(
        self, lit: Sequence[Sample], centre: Centre, moments: ArrivalMoments | None
    ) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]]:
        """Angles of the marker and their probabilities (10), from those of the centre of its curve."""
        angle_deg, share = centre.angles_deg, centre.share
        strongest = max(lit, key=lambda sample: sample.reading.intensity).reading
        coherence = mean_coherence(lit, sigma=self._scale.sigma)
        from_axis_m = radius_m(strongest.depth_m)
        width_m = from_axis_m * math.radians(centre.fwhm_deg)
        scale_deg = math.degrees(shift_scale_m(coherence, width_m=width_m) / from_axis_m)
        step_deg = float(angle_deg[1] - angle_deg[0])
        # A grid that does not resolve the shift is wide enough already.
        if "intensity" not in self._cues or step_deg > scale_deg:
            return angle_deg, share
        mean_deg = float(share @ angle_deg)
        half_deg = max(SHIFT_SCALES * scale_deg, (angle_deg[-1] - angle_deg[0]) / 2)
        angles_deg = mean_deg + np.linspace(-half_deg, half_deg, 2 * math.ceil(half_deg / step_deg) + 1)
        log_moments = np.zeros_like(angles_deg)
        if moments is not None:
            # Sound arrives from the marker, not from the centre of its curve: the moments' likelihood is divided out of
            # the centre's posterior and multiplied on again at the marker's angle.
            log_moments = moments.log_likelihood(angles_deg, knots=2 * FINE_KNOTS)
            log_moments -= log_moments.max()
            share = share * np.exp(np.minimum(-np.interp(angle_deg, angles_deg, log_moments), 30.0))
            share = share / share.sum()
        density = shifted_density(
            angle_deg,
            share,
            angles_deg,
            probability=asymmetry_probability(coherence, width_m=width_m),
            scale_deg=scale_deg,
        )
        density *= np.exp(log_moments)
        return angles_deg, density / density.sum()


def refine(
    shapes: Shapes,
    coarse: Grid,
    known: Marginals,
    observations: Sequence[Observation],
    log_prior: Callable[[Float64[np.ndarray, " angles"]], Float64[np.ndarray, " angles"]],
    *,
    particles: int,
) -> Centre:
    """Return the posterior of the centre of the curve, in steps as fine as it is narrow.

    Parameters
    ----------
    shapes
        Family of curves.
    coarse, known
        The coarse grid and its probabilities.
    observations
        All observations; none if the intensities do not count: then the grid stays coarse.
    log_prior
        Gives ln of the prior of angles, the likelihoods of other cues included.
    particles
        Markers to draw.
    """
    grid, best = coarse, known
    strong = strong_observations(observations)
    symmetric = len(strong) >= LEAST_STRONG
    # One refinement is enough before the symmetric likelihood, which has its own angles.
    for _ in range(1 if symmetric else 2):
        half_deg = _half_width_deg(grid.angles_deg, best.angle)
        step_deg = float(grid.angles_deg[1] - grid.angles_deg[0])
        # A posterior that fills the grid, or is resolved already, gains nothing from a finer one.
        if not observations or half_deg >= 0.4 * (grid.angles_deg[-1] - grid.angles_deg[0]) / 2:
            break
        if grid is not coarse and step_deg <= 0.25 * half_deg / HALF_WIDTH_SIGMAS:
            break
        grid = finer(shapes, grid, best, observations, half_deg=half_deg, angles=FINE_ANGLES)
        best = grid.marginals(log_prior(grid.angles_deg), particles=particles)
    fwhm_deg = float(best.shape @ shapes.fwhm_deg[grid.members])
    if grid is coarse or not symmetric:
        return Centre(
            angles_deg=grid.angles_deg, share=best.angle, particles=best.particles, fwhm_deg=fwhm_deg, strong=[]
        )
    # The template's error is g now: few shapes are enough, the Gaussian process makes up for the others.
    members = grid.members[np.sort(np.argsort(-best.shape, kind="stable")[:SYMMETRY_SHAPES])]
    remaining = hypotheses_of(shapes, members)
    angles_deg, share = grid.angles_deg, best.angle
    # A posterior wider than the curve may have a narrow mode beside a wide one, and coarse angles would step over it.
    step_deg = SYMMETRY_STEP * float(shapes.fwhm_deg[members].min())
    for usual in SYMMETRY_ANGLES:
        hypotheses = remaining
        half_deg = _half_width_deg(angles_deg, share)
        count = usual if half_deg <= fwhm_deg else min(math.ceil(2 * half_deg / step_deg), MOST_SYMMETRY_ANGLES)
        angles_deg = float(share @ angles_deg) + np.linspace(-half_deg, half_deg, count)
        log_p, log_amplitude = symmetric_log_likelihood(shapes, hypotheses, observations, angles_deg)
        log_p += hypotheses.log_prior + log_prior(angles_deg)[:, None]
        weight = np.exp(log_p - log_p.max())
        share = weight.sum(axis=1) / weight.sum()
        by_hypothesis = weight.sum(axis=0)
        # The second, finer pass costs in proportion to the hypotheses that are left.
        remaining = hypotheses.kept(np.flatnonzero(by_hypothesis > LEAST_SHARE * by_hypothesis.max()))
    row, column = _drawn(weight, particles)
    drawn = Particles(
        theta_deg=angles_deg[row], member=hypotheses.member[column], log_amplitude=log_amplitude[row, column]
    )
    return Centre(angles_deg=angles_deg, share=share, particles=drawn, fwhm_deg=fwhm_deg, strong=strong)


def _drawn(
    weight: Float64[np.ndarray, "angles hypotheses"], count: int
) -> tuple[Int64[np.ndarray, " drawn"], Int64[np.ndarray, " drawn"]]:
    """Angle and hypothesis of cells drawn by systematic resampling, at equal steps of the cumulative weight."""
    cumulative = np.cumsum(weight)
    drawn = np.searchsorted(cumulative, cumulative[-1] * (np.arange(count) + 0.5) / count)
    row, column = np.divmod(drawn, weight.shape[1])
    return row, column


def _half_width_deg(angles_deg: Float64[np.ndarray, " angles"], share: Float64[np.ndarray, " angles"]) -> float:
    """Half the width of the next finer grid, in degrees."""
    step_deg = float(angles_deg[1] - angles_deg[0])
    return max(HALF_WIDTH_SIGMAS * mean_and_sigma(angles_deg, share)[1], 2 * step_deg)
