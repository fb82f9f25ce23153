"""From samples to the posterior of the angle: coarse grid, finer grids, symmetric likelihood, asymmetry.

1. A coarse grid over the whole range takes each observation once.
2. Finer grids follow the posterior down where it is narrow.
3. Once three samples are strong, the likelihood of a symmetric curve (7) replaces the grid's, about the grid's mean.
4. Where the frames show that the marker moves, or the samples scatter as if it did, its displacements are integrated
   out (`motion`).
5. The posterior of the curve's centre is widened by the shift of asymmetric markers (10), in `asymmetry`.
"""

from __future__ import annotations

import copy
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from markerseek.core import Float64, Interval, MarkerCurve, Sample
from markerseek.search.floor import SearchNoise, above_background, noise_above_background
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.arrival import arrival_likelihood
from markerseek.search.posterior.asymmetry import (
    asymmetry_probability,
    mean_coherence,
    shift_scale_m,
    shifted_density,
)
from markerseek.search.posterior.centre import Centre, LogDensity, blurred, refine
from markerseek.search.posterior.grid import Grid, mean_and_sigma
from markerseek.search.posterior.likelihood import Observation, Scale, radius_m, scale_of
from markerseek.search.posterior.motion import motion_of
from markerseek.search.posterior.moved_centre import with_motion
from markerseek.search.posterior.shapes import family, log_amplitude_prior, shapes_with
from markerseek.search.posterior.symmetry import USUAL_PULSE_ERROR, median_of

BEYOND_STEPS = 12
"""Coarse steps by which the grid extends beyond each end of the range."""

BEYOND_SHARE = 0.05
"""Prior density there over that inside."""

COARSE_STEPS = 140
"""Coarse steps over the range: half a degree for ±35°."""

SHIFT_SCALES = 6.0
"""Reach of the marker's angles to either side, in scales of the shift: 99.6 % of its distribution."""


class Inference:
    """The posterior of one search, with the coarse grid that grows with its samples.

    ``cues``: which of "intensity", "arrival" and "lateral" count. ``prior``: what is known of the curve before the
    first sample; None: what the physics table says. ``motion_m``: amplitude of the tissue's motion that the rig states;
    None: nothing.
    """

    def __init__(
        self,
        *,
        limits: Interval,
        cues: frozenset[str],
        prior: MarkerCurve | None = None,
        motion_m: float | None = None,
    ) -> None:
        self.cues = cues
        self._limits = limits
        self._prior = prior
        self._motion_m = motion_m
        self._shapes = family() if prior is None else shapes_with(family(), prior)
        step_deg = limits.width_deg / COARSE_STEPS
        self._coarse_deg = limits.low_deg + step_deg * np.arange(-BEYOND_STEPS, COARSE_STEPS + BEYOND_STEPS + 1)
        inside = (self._coarse_deg >= limits.low_deg - step_deg / 2) & (
            self._coarse_deg <= limits.high_deg + step_deg / 2
        )
        # Uniform inside, and a little beyond: without it a marker beyond an end would seem certain to be at that end.
        self._log_prior = np.where(inside, 0.0, math.log(BEYOND_SHARE))
        self._grid: Grid | None = None
        self._scale = Scale(unit=0.0, sigma=1.0, marker_m=None, cells=1, radius_m=radius_m(None))
        self._observations: list[Observation] = []
        self._added: list[tuple[float, float, int | None]] = []
        self._swept = False
        self.order_sigma_deg = 0.0
        """Standard deviation of the angle by what the order of the frames of sweeps leaves open, in degrees."""

    def anew(self) -> Inference:
        """Return an inference as this one was before its first sample."""
        return Inference(limits=self._limits, cues=self.cues, prior=self._prior, motion_m=self._motion_m)

    def copy(self) -> Inference:
        """Return an inference with the same samples, which takes further ones by itself."""
        twin = copy.copy(self)
        twin._observations = list(self._observations)  # noqa: SLF001 - of this class
        twin._grid = None if self._grid is None else self._grid.copy()  # noqa: SLF001 - of this class
        return twin

    def posterior(
        self, lit: Sequence[Sample], noise: SearchNoise, *, particles: int, bounds: Sequence[Sample] = ()
    ) -> AnglePosterior:
        """Return the posterior of all samples; only the new ones are added to the coarse grid.

        The grid is computed again where an earlier sample reads otherwise than before, for it was taken of a place that
        is known better now.

        ``lit``: samples with the laser on, at least one. ``particles``: markers to draw. ``bounds``: samples that say
        only how strong the source is at most (`as_upper_limit`).
        """
        coarse = self._coarse(lit, bounds, noise)
        first_deg = self._coarse_deg[0]
        last_deg = self._coarse_deg[-1]
        log_moments = arrival_likelihood(lit, self._scale, first_deg, last_deg) if "arrival" in self.cues else None

        def log_arrival(angles_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]:
            inside_deg = np.clip(angles_deg, first_deg, last_deg)
            return np.zeros(angles_deg.size) if log_moments is None else np.asarray(log_moments(inside_deg))

        def log_prior(angles_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]:
            return np.asarray(np.interp(angles_deg, self._coarse_deg, self._log_prior) + log_arrival(angles_deg))

        known = coarse.marginals(log_prior(self._coarse_deg), particles=particles)
        observations = self._observations if "intensity" in self.cues else []
        centre = refine(self._shapes, coarse, known, observations, log_prior, particles=particles)
        mean_deg = float(centre.probability @ centre.angles_deg)
        # What the rig states of the motion is in the displacements that cameras saw.
        seen = all(sample.displacement is not None for sample in lit)
        stated_m = None if seen else self._motion_m
        motion = motion_of(lit, mean_deg=mean_deg, sigma=self._scale.sigma, stated_m=stated_m)
        if "intensity" in self.cues:
            strongest = max(lit, key=lambda sample: sample.reading.intensity).reading
            from_axis_m = radius_m(strongest.depth_m)
            centre = with_motion(centre, motion, from_axis_m=from_axis_m, particles=particles)
        sigma_deg = math.hypot(
            self.order_sigma_deg, shared_displacement_deg(self._observations, fwhm_deg=centre.fwhm_deg)
        )
        if sigma_deg > 0:
            wider = blurred(centre.angles_deg, centre.probability, sigma_deg=sigma_deg)
            centre = replace(centre, angles_deg=wider[0], probability=wider[1])
        angle_deg, probability = self._with_asymmetry(lit, centre, log_arrival)
        scale = self._scale
        log_unit = math.log(scale.unit) - math.log(scale.sigma)
        medians = [median_of(group) for group in centre.strong]
        return AnglePosterior(
            angle_deg=angle_deg,
            probability=probability,
            coarse_deg=self._coarse_deg,
            coarse_probability=known.angle,
            sigma=scale.sigma,
            theta_deg=centre.particles.theta_deg,
            member=centre.particles.member,
            log_snr=centre.particles.log_amplitude + log_unit,
            strong_deg=np.array([each.angle_deg for each in medians]),
            strong_log_snr=np.array([each.log_intensity for each in medians]) + log_unit,
            strong_samples=np.array([len(group) for group in centre.strong], dtype=np.int64),
            energy_gain=None if centre.log_gain is None else math.exp(centre.log_gain),
            sample_error=centre.sample_error,
            fwhm_deg=centre.fwhm_deg,
            centre_sigma_deg=centre.centre_sigma_deg or mean_and_sigma(centre.angles_deg, centre.probability)[1],
            motion=motion,
            moved_sigma_deg=centre.moved_sigma_deg,
            measured_again=centre.measured_again,
        )

    def _coarse(self, lit: Sequence[Sample], bounds: Sequence[Sample], noise: SearchNoise) -> Grid:
        """Return the coarse grid with all samples; computed again when their scale has changed."""
        # Not of the bounds, which may be of a far stronger source: the amplitudes of the grid begin at half the unit.
        scale = scale_of(lit, noise)
        own = len(lit)
        lit = [*lit, *bounds]
        stated = all(sample.reading.noise_sigma is not None and sample.reading.cells is not None for sample in lit)
        known = [(sample.angle_deg, sample.reading.intensity, sample.reading.cells) for sample in lit]
        same = known[: len(self._added)] == self._added
        self._added = known
        swept = any(sample.sweep is not None for sample in lit)
        if self._grid is None or not same or swept != self._swept or scale.replaces(self._scale, stated=stated):
            self._scale = scale
            self._swept = swept
            self._observations = []
            prior = None if self._prior is None else log_amplitude_prior(self._prior, unit=scale.unit)
            self._grid = Grid(
                shapes=self._shapes,
                angles_deg=self._coarse_deg,
                # Every third shape: neighbouring widths differ by 10 % and are hard to tell apart.
                members=np.arange(0, self._shapes.fwhm_deg.size, 3),
                lowest=math.log(0.5),
                phases=15,
                amplitudes=18,
                blur=0.125,
                log_amplitude_prior=prior,
                energy_error=USUAL_PULSE_ERROR if swept else 0.0,
            )
        for number, sample in list(enumerate(lit))[len(self._observations) :]:
            # Those of the bounds come last, and say nothing of a displacement.
            observation = self._scale.observation(
                sample, use_lateral="lateral" in self.cues, swept=swept, number=number if number < own else -1
            )
            self._observations.append(observation)
            if "intensity" in self.cues:
                self._grid.add(observation)
        return self._grid

    def _with_asymmetry(
        self, lit: Sequence[Sample], centre: Centre, log_arrival: LogDensity
    ) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]]:
        """Return the angles of the marker and their probabilities (10), from those of the centre of its curve."""
        strongest = max(lit, key=lambda sample: sample.reading.intensity).reading
        coherence = mean_coherence(lit, sigma=self._scale.sigma)
        from_axis_m = radius_m(strongest.depth_m)
        width_m = from_axis_m * math.radians(centre.fwhm_deg)
        spot = asymmetry_probability(coherence, width_m=width_m)
        angle_deg, probability = _as_of_one_way(centre, spot=spot)
        scale_deg = math.degrees(shift_scale_m(coherence, width_m=width_m) / from_axis_m)
        step_deg = float(angle_deg[1] - angle_deg[0])
        # A grid that does not resolve the shift is wide enough already.
        if "intensity" not in self.cues or step_deg > scale_deg:
            return angle_deg, probability
        mean_deg = float(probability @ angle_deg)
        half_deg = max(SHIFT_SCALES * scale_deg, (angle_deg[-1] - angle_deg[0]) / 2)
        angles_deg = mean_deg + np.linspace(-half_deg, half_deg, 2 * math.ceil(half_deg / step_deg) + 1)
        # Sound arrives from the marker, not from the centre of its curve: the moments are divided out of
        # the centre's posterior, and multiplied on again at the marker's angle.
        log_moments = log_arrival(angles_deg)
        log_moments -= log_moments.max()
        probability = probability * np.exp(np.minimum(-np.interp(angle_deg, angles_deg, log_moments), 30.0))
        density = shifted_density(
            angle_deg,
            probability / probability.sum(),
            angles_deg,
            probability=spot,
            scale_deg=scale_deg,
        )
        density *= np.exp(log_moments)
        return angles_deg, density / density.sum()


def _as_of_one_way(
    centre: Centre, *, spot: float
) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]]:
    """Return the angles of the centre and their probabilities, as wide as one way over a spot leaves them.

    Its absorbers interfere at each angle in another way. That looks like an error of each pulse by itself, but every
    further way over the spot repeats it. ``spot``: probability that the marker is one.
    """
    swept = [each.sweep for group in centre.strong for each in group if each.sweep is not None]
    further = len({(sweep.number, sweep.speed_deg_s > 0) for sweep in swept}) - 1
    if further < 1:
        return centre.angles_deg, centre.probability
    sigma_deg = mean_and_sigma(centre.angles_deg, centre.probability)[1]
    return blurred(centre.angles_deg, centre.probability, sigma_deg=sigma_deg * math.sqrt(spot * further))


def shared_displacement_deg(observations: Sequence[Observation], *, fwhm_deg: float) -> float:
    """By how much the angle may be shifted by what is not known of the tissue's displacement during sweeps.

    All samples of one way of a sweep share it. The likelihood takes it for an error of each sample by itself, which
    weighs the ways. ``fwhm_deg``: full width of the curve at half maximum.
    """
    strong = [each for each in observations if each.strong]
    # On its flank, at half maximum, ln S of a Gaussian falls by 4 ln 2 in a full width.
    by_shift = [4 * math.log(2) * each.displaced_sigma_deg / fwhm_deg for each in strong]
    weight = [
        (each.noise**2 + USUAL_PULSE_ERROR**2 + shift**2) ** -1 for each, shift in zip(strong, by_shift, strict=True)
    ]
    by_way: dict[tuple[int, bool], float] = {}
    for each, own in zip(strong, weight, strict=True):
        if each.sweep is not None:
            way = (each.sweep.number, each.sweep.speed_deg_s > 0)
            by_way[way] = by_way.get(way, 0.0) + own * each.displaced_sigma_deg
    return math.hypot(*by_way.values()) / sum(weight) if by_way else 0.0


MIN_ENERGIES = 6
"""Samples of the marker from which its curve, which is not known either, shows how the laser's energy differs."""


def energy_spread(lit: Sequence[Sample], dark: Sequence[Sample] = (), *, limits: Interval) -> float | None:
    """Return the relative standard deviation of an acquisition's energy; None where too few samples show it.

    ``lit``, ``dark``: samples of one marker, with the laser on and off.
    """
    energies = [sample.frame.header.energy for sample in lit if sample.frame is not None]
    measured = [math.log(energy) for energy in energies if energy is not None]
    if len(measured) >= MIN_ENERGIES:
        return statistics.stdev(measured)
    noise = noise_above_background(lit, dark=dark)
    lit = above_background(lit, noise.background)
    level = math.inf if noise.floor.level is None else noise.floor.level
    if sum(sample.reading.intensity > level for sample in lit) < MIN_ENERGIES:
        return None
    inference = Inference(limits=limits, cues=frozenset({"intensity"}))
    return inference.posterior(lit, noise, particles=8).sample_error
