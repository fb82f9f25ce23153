"""From samples to the posterior of the angle: coarse grid, finer grids, symmetric likelihood, asymmetry.

1. A coarse grid over the whole range takes each observation once.
2. Finer grids follow the posterior down where it is narrow.
3. Once three samples are strong, the likelihood of a symmetric curve (7) replaces the grid's, about the grid's mean.
4. Where the frames show that the marker moves, or the samples scatter as if it did, its displacements are integrated
   out (`motion`).
5. The posterior of the curve's centre is widened by the shift of asymmetric markers (10).

The curve of a point is symmetric. That of a stained spot is not: its absorbers interfere, and the centre of the curve
lies some tenths of a millimetre beside the centroid of the spot; tissue on the way shifts it as well. All samples of
one curve share its centre, so that more of them do not show the shift: it is a nuisance parameter, and the posterior is
widened by it,

    p(θ) = (1 − u)·q(θ) + u·∫ q(θ') t₄((θ − θ')·ρ/a) dθ'·ρ/a,                                                (10)

with q the posterior of the centre, u the probability that the marker is such a spot, ρ its distance from the axis, and
t₄ Student's density with four degrees of freedom, because most spots are shifted by little and some by much (on 285
simulated spots it was more likely than a normal density by exp(18)).

All sound of a point is in phase over the array at its best focus (`Reading.focused_coherence`, C), whatever its pulse
and the speed of sound; that of a spot wider than the array resolves is not. Bayes' rule gives u from the mean of C over
the samples: that of a point is 1 but for a small deviation, that of a spot may have any value. A long wave resolves
little: then a spot may look like a point, and its curve, for the same reason, is wide. Where the width w of the curve,
as a length at the marker, is large, more of the spots are therefore expected at C = 1. Two sources that sound at once
are taken for a spot: the interval is then too wide rather than too narrow.

The less of the sound is in phase, the more C differs from angle to angle (s, its standard deviation: the absorbers
interfere differently at each), and the wider the curve, the larger is the shift:

    a = (a₀ + a₁·(1 − C) + a₂·s)·√(w/5 mm).                                                                  (10c)
"""

from __future__ import annotations

import copy
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from markerseek.core import Float64, Int64, Interval, MarkerCurve, Sample
from markerseek.search.floor import SearchNoise, above_background, noise_above_background
from markerseek.search.posterior.arrival import arrival_likelihood
from markerseek.search.posterior.grid import Grid, Marginals, Particles, finer, mean_and_sigma
from markerseek.search.posterior.likelihood import Observation, Scale, radius_m, scale_of
from markerseek.search.posterior.motion import SIGMAS_M, TurnMotion, motion_of
from markerseek.search.posterior.shapes import STEP_DEG, Shapes, family, log_amplitude_prior, shapes_with
from markerseek.search.posterior.symmetry import (
    MIN_STRONG,
    PULSE_ERRORS,
    SAMPLE_ERRORS,
    USUAL_PULSE_ERROR,
    USUAL_SAMPLE_ERROR,
    Displaced,
    Grouped,
    Hypotheses,
    grouped,
    hypotheses_of,
    median_of,
    symmetric_log_likelihood,
    with_energies,
)

LogDensity: TypeAlias = Callable[[Float64[np.ndarray, " angles"]], Float64[np.ndarray, " angles"]]
"""ln of a density, without a constant factor, as a function of angles in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AnglePosterior:
    """The posterior of the angle."""

    angle_deg: Float64[np.ndarray, " angles"]
    """Angles in degrees, evenly spaced."""
    probability: Float64[np.ndarray, " angles"]
    """Probability of each angle; they add up to 1."""
    coarse_deg: Float64[np.ndarray, " coarse"]
    """Angles over the whole range in degrees, evenly spaced."""
    coarse_probability: Float64[np.ndarray, " coarse"]
    """Probability of each of these, of the grid alone."""
    sigma: float
    """Noise over which amplitudes are stated, in the unit of the intensities."""
    theta_deg: Float64[np.ndarray, " particles"]
    """Angles of markers of equal weight drawn from the posterior, in degrees."""
    member: Int64[np.ndarray, " particles"]
    """Their shapes, as indices into the family."""
    log_snr: Float64[np.ndarray, " particles"]
    """ln of their amplitudes over σ."""
    strong_deg: Float64[np.ndarray, " strong"]
    """Angles of the groups of samples to which a symmetric curve was fitted; empty if too few are strong."""
    strong_log_snr: Float64[np.ndarray, " strong"]
    """ln of the intensity of each group over σ."""
    strong_samples: Int64[np.ndarray, " strong"]
    """Number of samples of each group."""
    energy_gain: float | None
    """What the amplitude of a spot's energy is multiplied by to be as high as the peak at the top of the curve; None
    where the curve is that of the peak."""
    sample_error: float
    """Relative error of one sample by itself, the laser's energy."""
    fwhm_deg: float
    """Mean of the curve's full width at half maximum."""
    centre_sigma_deg: float
    """Standard deviation of the centre of the curve: what more samples can still reduce."""
    motion: TurnMotion | None = None
    """What the frames show of the marker's motion; None: it was not looked for."""
    moved_sigma_deg: float = 0.0
    """Standard deviation of the angle by which the marker is displaced along the turn at a sample."""

    @property
    def mean_deg(self) -> float:
        """Mean of the angle in degrees."""
        return float(self.probability @ self.angle_deg)

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of the angle in degrees, the width of the grid's step included."""
        return mean_and_sigma(self.angle_deg, self.probability)[1]

    def log_heights(self, angles_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, "particles angles"]:
        """Return ln of the intensity over σ that each marker drawn has at angles of the probe, in degrees."""
        log_curve = family().log_curve
        steps = np.rint(np.abs(angles_deg - self.theta_deg[:, None]) / STEP_DEG).astype(np.int64)
        away = np.minimum(steps, log_curve.shape[1] - 1)
        return np.asarray(self.log_snr[:, None] + log_curve[self.member[:, None], away])

    def quantile_deg(self, probability: float) -> float:
        """Return the angle below which the marker lies with that probability, in degrees."""
        return float(np.interp(probability, *self._steps()))

    def cumulative(self, angles_deg: Float64[np.ndarray, " ends"]) -> Float64[np.ndarray, " ends"]:
        """Return the probability with which the marker lies below each angle, in degrees."""
        probability, ends_deg = self._steps()
        return np.asarray(np.interp(angles_deg, ends_deg, probability))

    def _steps(self) -> tuple[Float64[np.ndarray, " ends"], Float64[np.ndarray, " ends"]]:
        """Return the cumulative probability at the ends of the steps.

        Each probability is uniform over one step of the grid.
        """
        step_deg = float(self.angle_deg[1] - self.angle_deg[0])
        ends_deg = np.concatenate([self.angle_deg - step_deg / 2, self.angle_deg[-1:] + step_deg / 2])
        return np.concatenate([[0.0], np.cumsum(self.probability)]), ends_deg


MODE_PROBABILITY = 0.05
"""Probability from which a second peak of the posterior is a mode."""


def modes_deg(posterior: AnglePosterior, *, limits: Interval) -> tuple[float, ...]:
    """Return the peaks of the posterior with gaps between them, the most probable first, in degrees."""
    probability = posterior.coarse_probability
    # Runs of angles above 1e-4 of the maximum: +1 where one begins, -1 behind its end.
    above = probability > 1e-4 * probability.max()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above.astype(np.int64), [0]])))
    modes = []
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        mass = float(probability[first:end].sum())
        if mass > MODE_PROBABILITY:
            mean_deg = float(probability[first:end] @ posterior.coarse_deg[first:end]) / mass
            modes.append((mass, limits.nearest(mean_deg)))
    return tuple(mean_deg for _, mean_deg in sorted(modes, reverse=True))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Centre:
    """The posterior of the centre of the curve."""

    angles_deg: Float64[np.ndarray, " angles"]
    """Angles in degrees, evenly spaced."""
    probability: Float64[np.ndarray, " angles"]
    """Probability of each angle; they add up to 1."""
    particles: Particles
    fwhm_deg: float
    """Mean of the curve's full width at half maximum."""
    strong: Sequence[Sequence[Observation]]
    """Groups of observations to which a symmetric curve was fitted; none if too few are strong."""
    log_gain: float | None
    """ln of the factor of the spot's energies, `with_energies`; None if the curve is that of the peak."""
    sample_error: float
    """Mean of the relative error of one sample by itself, the laser's energy."""
    fit: _Fit | None = None
    """What the symmetric likelihood was computed with; None where it was not."""
    moved_sigma_deg: float = 0.0
    """As of `AnglePosterior`."""
    centre_sigma_deg: float | None = None
    """Standard deviation of the centre over the places of a marker that moves; None: that of ``probability``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """What a symmetric likelihood was computed with."""

    shapes: Shapes
    at_rest: Hypotheses
    """Shapes with the errors of samples of a marker that rests."""
    moving: Hypotheses
    """The same shapes with those of one that moves in depth."""
    samples: Grouped
    log_prior: LogDensity


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


FINE_ANGLES = 33
"""Angles of a finer grid."""

SYMMETRY_ANGLES = (13, 25)
"""Angles at which the symmetric likelihood is computed: while they become narrower, and at last."""

SYMMETRY_STEP = 0.02
MAX_SYMMETRY_ANGLES = 151
"""Their step over the full width at half maximum where they are spread wider than that, and their largest number."""

SYMMETRY_SHAPES = 6
"""Shapes with which it is computed, the most probable."""

MAX_TURNS = 6
"""How often they are computed at most."""

NARROWER = 2.5
"""Ratio of two of their spreads from which they are computed again before the last time; a posterior within one step
makes the next spread, of two steps to either side, three times as narrow."""

EDGE_SHARE = 0.01
"""Probability at an end of these angles, over that of the most probable, from which they are spread twice as wide."""

_MIN_SHARE = 0.01
"""Probability of a hypothesis, over that of the most probable, below which it is dropped in between."""

HALF_WIDTH_SIGMAS = 5.0
"""Half the width of the next finer grid, in standard deviations."""


def refine(
    shapes: Shapes,
    coarse: Grid,
    known: Marginals,
    observations: Sequence[Observation],
    log_prior: LogDensity,
    *,
    particles: int,
) -> Centre:
    """Return the posterior of the centre of the curve, in steps as fine as it is narrow.

    ``observations``: all observations; none if the intensities do not count: then the grid stays coarse. ``log_prior``:
    gives ln of the prior of angles, the likelihoods of other cues included. ``particles``: markers to draw.
    """
    grid = coarse
    best = known
    swept = any(each.sweep is not None for each in observations)
    samples = grouped(observations, fwhm_deg=float(known.shape @ shapes.fwhm_deg[coarse.members]))
    symmetric = sum(map(len, samples.strong)) >= MIN_STRONG
    # One refinement is enough before the symmetric likelihood, which has its own angles.
    for _ in range(1 if symmetric else 2):
        half_deg = _half_width_deg(grid.angles_deg, best.angle)
        step_deg = float(grid.angles_deg[1] - grid.angles_deg[0])
        # A posterior that fills the grid, or is resolved already, gains nothing from a finer one.
        if not observations or half_deg >= 0.4 * (grid.angles_deg[-1] - grid.angles_deg[0]) / 2:
            break
        if grid is not coarse and step_deg <= 0.25 * half_deg / HALF_WIDTH_SIGMAS:
            break
        grid = finer(
            shapes,
            grid,
            best,
            [*map(median_of, samples.strong), *samples.others],
            half_deg=half_deg,
            angles=FINE_ANGLES,
        )
        best = grid.marginals(log_prior(grid.angles_deg), particles=particles)
    fwhm_deg = float(best.shape @ shapes.fwhm_deg[grid.members])
    if grid is coarse or not symmetric:
        # The likelihood of a symmetric curve knows of the delay of a sweep, the grid's does not.
        angles_deg, probability = blurred(grid.angles_deg, best.angle, sigma_deg=delay_sigma_deg(observations))
        return Centre(
            angles_deg=angles_deg,
            probability=probability,
            particles=best.particles,
            fwhm_deg=fwhm_deg,
            strong=[],
            log_gain=None,
            sample_error=USUAL_PULSE_ERROR if swept else USUAL_SAMPLE_ERROR,
        )
    samples, log_gain = with_energies(samples)
    errors = PULSE_ERRORS if swept else SAMPLE_ERRORS
    # The template's error is g now: few shapes are enough, the Gaussian process makes up for the others.
    members = grid.members[np.sort(np.argsort(-best.shape, kind="stable")[:SYMMETRY_SHAPES])]
    angles_deg = grid.angles_deg
    probability = best.angle
    hypotheses = hypotheses_of(shapes, members, errors)
    # A posterior wider than the curve may have a narrow mode beside a wide one, and coarse angles would step over it.
    least_step_deg = SYMMETRY_STEP * float(shapes.fwhm_deg[members].min())
    half_deg = _half_width_deg(angles_deg, probability)
    former_deg = math.inf
    for turn in range(MAX_TURNS):
        # With all angles at last, and without a blur.
        last = turn == MAX_TURNS - 1 or former_deg / NARROWER < half_deg <= former_deg
        count = SYMMETRY_ANGLES[last]
        if half_deg > fwhm_deg:
            count = min(math.ceil(2 * half_deg / least_step_deg), MAX_SYMMETRY_ANGLES)
        angles_deg = float(probability @ angles_deg) + np.linspace(-half_deg, half_deg, count)
        blur_deg = 0.0 if last else float(angles_deg[1] - angles_deg[0])
        log_p, log_amplitude = symmetric_log_likelihood(shapes, hypotheses, samples, angles_deg, blur_deg=blur_deg)
        log_p += hypotheses.log_prior + log_prior(angles_deg)[:, None]
        weight = np.exp(log_p - log_p.max())
        probability = weight.sum(axis=1) / weight.sum()
        if last:
            break
        former_deg = half_deg
        # Many samples of a curve that is not of the family make a grid too certain, beside the marker.
        beside = max(probability[0], probability[-1]) > EDGE_SHARE * probability.max()
        half_deg = 2 * half_deg if beside else _half_width_deg(angles_deg, probability)
        # What comes next costs in proportion to the hypotheses that are left.
        by_hypothesis = weight.sum(axis=0)
        hypotheses = hypotheses.kept(np.flatnonzero(by_hypothesis > _MIN_SHARE * by_hypothesis.max()))
    sample_error = float(weight.sum(axis=0) @ hypotheses.sample_error / weight.sum())
    of_each_width = _of_each_width(shapes, grid, best)
    row, column = _drawn(weight, particles)
    drawn = Particles(
        theta_deg=angles_deg[row], member=hypotheses.member[column], log_amplitude=log_amplitude[row, column]
    )
    return Centre(
        angles_deg=angles_deg,
        probability=probability,
        particles=drawn,
        fwhm_deg=fwhm_deg,
        strong=samples.strong,
        log_gain=log_gain,
        sample_error=sample_error,
        fit=_Fit(
            shapes=shapes,
            at_rest=hypotheses_of(shapes, of_each_width, errors),
            moving=hypotheses_of(shapes, of_each_width, MOVED_ERRORS),
            samples=samples,
            log_prior=log_prior,
        ),
    )


def _of_each_width(shapes: Shapes, grid: Grid, best: Marginals) -> Int64[np.ndarray, " widths"]:
    """Return the most probable shape of each width: which width it is, looks different where the marker moves."""
    width_deg = shapes.fwhm_deg[grid.members]
    order = np.argsort(-best.shape, kind="stable")
    _, first = np.unique(np.round(width_deg[order], 6), return_index=True)
    return np.asarray(np.sort(grid.members[order[first]]))


MOTION_DOUBT = 0.05
"""Probability that the marker moves from which its displacements are integrated out."""

SCATTERING = 0.08
"""Relative error of a sample by itself from which samples at rest scatter as no laser does (the largest of
`SAMPLE_ERRORS` is 0.09): the marker may move just along the turn, where frames show nothing of it."""

MOVED_ERRORS: tuple[tuple[float, float], ...] = ((0.02, 0.45), (0.08, 0.35), (0.25, 0.2))
"""Relative errors of one sample of a marker that moves, and the prior probability of each. An average of pulses is
blurred: a marker that moves in depth by half a wavelength meanwhile, some 0.1 mm, loses a part of its height."""

MOTION_ANGLES = 81
MOTION_STEPS = 801
"""Angles at which the likelihood of each motion is computed, and most steps of the posterior over all of them."""

_LEAST_WINDOW_M = 0.3e-3
"""Displacement over which the evidence of each motion is integrated at least, that of rest as well: the narrow
posterior of a marker at rest may lie beside the angle that explains the samples best."""

LEAST_MOTION = 1e-3
"""Probability by the frames, over that of the most probable, below which a motion is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _MovedCentre:
    """The posterior of the centre of the curve for one size of the motion."""

    hypotheses: Hypotheses
    moved_deg: float
    """Standard deviation of the displacement along the turn."""
    log_evidence: float
    angles_deg: Float64[np.ndarray, " angles"]
    weight: Float64[np.ndarray, "angles hypotheses"]
    """Probability of each angle and hypothesis; they add up to 1."""
    log_amplitude: Float64[np.ndarray, "angles hypotheses"]

    @property
    def probability(self) -> Float64[np.ndarray, " angles"]:
        """Probability of each angle."""
        return np.asarray(self.weight.sum(axis=1))


def with_motion(centre: Centre, motion: TurnMotion, *, from_axis_m: float, particles: int) -> Centre:
    """Return the posterior of the centre with the displacements along the turn integrated out.

    The place in the pause is the marker's: the centre over its places is blurred by the displacement from it.

    ``from_axis_m``: distance of the marker from the axis. ``particles``: markers to draw.
    """
    if motion.probability[0] == 1 and not motion.looked_at:
        # Of intensities alone, scatter is none of motion: two sources that overlap scatter about one curve too.
        return centre
    swept = any(each.sweep is not None for group in centre.strong for each in group)
    # Just along the turn, where frames show nothing.
    unseen = motion.probability[0] > 1 - MOTION_DOUBT
    if unseen and (swept or centre.sample_error <= SCATTERING):
        return centre
    moved_deg = np.degrees(SIGMAS_M / from_axis_m)
    fit = centre.fit
    if fit is None:
        # Too few samples for an evidence of their own.
        sigma_deg = math.sqrt(float(motion.probability @ moved_deg**2))
        angles_deg, probability = blurred(centre.angles_deg, centre.probability, sigma_deg=sigma_deg)
        return replace(centre, angles_deg=angles_deg, probability=probability, moved_sigma_deg=sigma_deg)
    mean_deg, still_deg = mean_and_sigma(centre.angles_deg, centre.probability)
    least_deg = math.degrees(_LEAST_WINDOW_M / from_axis_m)
    parts = []
    for sigma_deg, share in zip(moved_deg.tolist(), motion.probability.tolist(), strict=True):
        if share <= LEAST_MOTION * motion.probability.max():
            continue
        # Which direction along the turn goes with which one in depth is not known.
        signs = (1.0, -1.0) if sigma_deg > 0 and motion.relative_displacement.any() else (0.0,)
        for sign in signs:
            displaced = Displaced(
                by_deg=np.append(sign * sigma_deg * motion.relative_displacement, 0.0),
                sigma_deg=np.append(sigma_deg * motion.relative_sigma, sigma_deg),
            )
            parts.append(
                _moved_centre(
                    fit,
                    fit.moving if sigma_deg > 0 and not unseen else fit.at_rest,
                    displaced,
                    moved_deg=sigma_deg,
                    log_share=math.log(share / len(signs)),
                    angles_deg=mean_deg + math.hypot(still_deg, max(sigma_deg, least_deg)) * _MOTION_SIGMAS,
                )
            )
    log_evidence = np.array([each.log_evidence for each in parts])
    evidence = np.exp(log_evidence - log_evidence.max())
    if parts[0].moved_deg == 0 and evidence[0] > (1 - MOTION_DOUBT) * evidence.sum():
        return centre
    return _mixed(centre, fit, parts, evidence, particles=particles)


_MOTION_SIGMAS = np.linspace(-HALF_WIDTH_SIGMAS, HALF_WIDTH_SIGMAS, MOTION_ANGLES)


def _moved_centre(
    fit: _Fit,
    hypotheses: Hypotheses,
    displaced: Displaced,
    *,
    moved_deg: float,
    log_share: float,
    angles_deg: Float64[np.ndarray, " angles"],
) -> _MovedCentre:
    """Return the posterior for one size of the motion; ``log_share``: ln of its probability by the frames."""
    log_p, log_amplitude = symmetric_log_likelihood(
        fit.shapes, hypotheses, fit.samples, angles_deg, displaced=displaced
    )
    log_p += hypotheses.log_prior + fit.log_prior(angles_deg)[:, None]
    largest = float(log_p.max())
    weight = np.exp(log_p - largest)
    total = float(weight.sum())
    return _MovedCentre(
        hypotheses=hypotheses,
        moved_deg=moved_deg,
        log_evidence=log_share + largest + math.log(total * float(angles_deg[1] - angles_deg[0])),
        angles_deg=angles_deg,
        weight=weight / total,
        log_amplitude=log_amplitude,
    )


def _mixed(
    centre: Centre,
    fit: _Fit,
    parts: Sequence[_MovedCentre],
    evidence: Float64[np.ndarray, " parts"],
    *,
    particles: int,
) -> Centre:
    """Return the posterior over all motions by their evidence, each blurred by the displacement from the pause."""
    kept = [(each, share) for each, share in zip(parts, evidence.tolist(), strict=True) if share > _MIN_SHARE]
    total = sum(share for _, share in kept)
    kept = [(each, share / total) for each, share in kept]
    wider = [blurred(each.angles_deg, each.probability, sigma_deg=each.moved_deg) for each, _ in kept]
    low_deg = min(float(angles_deg[0]) for angles_deg, _ in wider)
    high_deg = max(float(angles_deg[-1]) for angles_deg, _ in wider)
    step_deg = min(float(angles_deg[1] - angles_deg[0]) for angles_deg, _ in wider)
    angles_deg = np.linspace(low_deg, high_deg, min(math.ceil((high_deg - low_deg) / step_deg) + 1, MOTION_STEPS))
    probability = np.zeros(angles_deg.size)
    for (_, share), (own_deg, own) in zip(kept, wider, strict=True):
        density = np.interp(angles_deg, own_deg, own, left=0.0, right=0.0)
        probability += share * density / density.sum()
    moments = np.array([mean_and_sigma(each.angles_deg, each.probability) for each, _ in kept])
    shares = np.array([share for _, share in kept])
    mean_deg = float(shares @ moments[:, 0])
    by_hypothesis = [(share * each.weight.sum(axis=0), each.hypotheses) for each, share in kept]
    drawn = [_drawn_moved(each, math.ceil(particles * share)) for each, share in kept]
    return replace(
        centre,
        angles_deg=angles_deg,
        probability=probability,
        particles=Particles(
            theta_deg=np.concatenate([each.theta_deg for each in drawn]),
            member=np.concatenate([each.member for each in drawn]),
            log_amplitude=np.concatenate([each.log_amplitude for each in drawn]),
        ),
        fwhm_deg=sum(float(weight @ fit.shapes.fwhm_deg[each.member]) for weight, each in by_hypothesis),
        sample_error=sum(float(weight @ each.sample_error) for weight, each in by_hypothesis),
        moved_sigma_deg=math.sqrt(sum(share * each.moved_deg**2 for each, share in kept)),
        centre_sigma_deg=math.sqrt(float(shares @ (moments[:, 1] ** 2 + (moments[:, 0] - mean_deg) ** 2))),
    )


def _drawn_moved(part: _MovedCentre, count: int) -> Particles:
    """Return the markers of equal weight drawn from the posterior for one size of the motion."""
    row, column = _drawn(part.weight, count)
    return Particles(
        theta_deg=part.angles_deg[row],
        member=part.hypotheses.member[column],
        log_amplitude=part.log_amplitude[row, column],
    )


def _drawn(
    weight: Float64[np.ndarray, "angles hypotheses"], count: int
) -> tuple[Int64[np.ndarray, " drawn"], Int64[np.ndarray, " drawn"]]:
    """Return the angle and hypothesis of cells drawn by systematic resampling."""
    cumulative = np.cumsum(weight)
    drawn = np.searchsorted(cumulative, cumulative[-1] * (np.arange(count) + 0.5) / count)
    row, column = np.divmod(drawn, weight.shape[1])
    return row, column


def _half_width_deg(angles_deg: Float64[np.ndarray, " angles"], probability: Float64[np.ndarray, " angles"]) -> float:
    """Return half the width of the next finer grid, in degrees."""
    step_deg = float(angles_deg[1] - angles_deg[0])
    return max(HALF_WIDTH_SIGMAS * mean_and_sigma(angles_deg, probability)[1], 2 * step_deg)


def delay_sigma_deg(observations: Sequence[Observation]) -> float:
    """By how much the delay of sweeps may shift the angle: ways there and back shift it against one another."""
    swept = [(each.noise**-2, each.sweep) for each in observations if each.sweep is not None]
    if not swept:
        return 0.0
    shift_deg = sum(weight * sweep.speed_deg_s * sweep.delay_sigma_s for weight, sweep in swept)
    return abs(shift_deg) / sum(weight for weight, _ in swept)


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


def blurred(
    angles_deg: Float64[np.ndarray, " angles"], probability: Float64[np.ndarray, " angles"], *, sigma_deg: float
) -> tuple[Float64[np.ndarray, " wider"], Float64[np.ndarray, " wider"]]:
    """Return the angles and probabilities after a normal error of this standard deviation was added."""
    step_deg = float(angles_deg[1] - angles_deg[0])
    reach = math.ceil(4 * sigma_deg / step_deg)
    if reach < 2:
        return angles_deg, probability
    kernel = np.exp(-0.5 * (step_deg * np.arange(-reach, reach + 1) / sigma_deg) ** 2)
    wider_deg = angles_deg[0] + step_deg * np.arange(-reach, angles_deg.size + reach)
    return wider_deg, np.convolve(probability, kernel / kernel.sum())


SPOT_PRIOR = 0.3
"""Prior probability of an asymmetric marker."""

SHIFT_M = 0.105e-3
INCOHERENT_SHIFT_M = 0.05e-3
SCATTER_SHIFT_M = 1.5e-3
"""a₀, a₁ and a₂ in metres: the most likely values in 310 searches for simulated spots in four tissues, enlarged until
the intervals cover."""

USUAL_WIDTH_M = 5e-3
"""Width of a curve, as a length at the marker, to which `SHIFT_M` refers."""

USUAL_SHIFT_M = 0.2e-3
"""a in metres if the frames do not tell C and s: the value of all 1,039 spots, whatever their width."""

POINT_SIGMA = 0.005
NOISE_SIGMA = 0.5
"""Root mean square deviation of a point's C from 1, from point to point, and by noise times the SNR: of 260 simulated
points at 30 and 40 dB with all unknowns drawn."""

UNRESOLVED_WIDTH_M = 9e-3
UNRESOLVED_POWER = 6
"""Width w₀ of the curve at which every second spot looks like a point, and the power n with which their share grows,
1/(1 + (w₀/w)ⁿ): of the 1,039 spots 1 % had C > 0.985 where w < 5 mm, 44 % where it was 12 to 15 mm."""

UNRESOLVED_INCOHERENCE = 0.05
"""Mean of 1 − C of the spots that look like points."""

UNLIKE_POINTS = 0.03
"""Share of points whose coherence may have any value, for example because something else sounds beside them."""


class MeanCoherence(NamedTuple):
    """The coherence C at the best focus, over the samples of one source."""

    mean: float
    sigma: float
    """Standard deviation of the mean if the source is a point."""
    scatter: float
    """Its standard deviation from sample to sample."""


def mean_coherence(lit: Sequence[Sample], *, sigma: float) -> MeanCoherence | None:
    """Return the mean and scatter of C over the samples; None if not known.

    ``lit``: samples with the laser on, as they are at the marker's place. ``sigma``: noise of one quadrature, in the
    intensity's unit.
    """
    known = [
        (sample.reading.focused_coherence, math.hypot(POINT_SIGMA, NOISE_SIGMA * sigma / sample.reading.intensity))
        for sample in lit
        if sample.reading.focused_coherence is not None and sample.reading.intensity > 0
    ]
    if not known:
        return None
    coherence, each_sigma = np.array(known).T
    precision = each_sigma**-2
    total = float(precision.sum())
    weight = precision / total
    mean = float(weight @ coherence)
    return MeanCoherence(
        mean=mean,
        # The samples of one point share its own deviation.
        sigma=math.hypot(POINT_SIGMA, 1 / math.sqrt(total)),
        scatter=math.sqrt(float(weight @ (coherence - mean) ** 2)),
    )


def asymmetry_probability(coherence: MeanCoherence | None, *, width_m: float) -> float:
    """Return u of (10).

    ``width_m``: full width of the curve at half maximum, as a length at the marker.
    """
    if coherence is None:
        return SPOT_PRIOR
    incoherence = 1 - coherence.mean
    sigma = coherence.sigma
    # A half-normal distribution.
    of_point = UNLIKE_POINTS + (1 - UNLIKE_POINTS) * math.exp(-((incoherence / sigma) ** 2) / 2) / (
        sigma * math.sqrt(math.pi / 2)
    )
    unresolved = 1 / (1 + (UNRESOLVED_WIDTH_M / width_m) ** UNRESOLVED_POWER)
    # A resolved spot may have any coherence from 0 to 1, each as probably: those of patches of 5 mm were 0.3 to 0.8.
    resolved = 1.0
    like_point = math.exp(-incoherence / UNRESOLVED_INCOHERENCE) / UNRESOLVED_INCOHERENCE
    of_spot = UNLIKE_POINTS + (1 - UNLIKE_POINTS) * ((1 - unresolved) * resolved + unresolved * like_point)
    return SPOT_PRIOR * of_spot / (SPOT_PRIOR * of_spot + (1 - SPOT_PRIOR) * of_point)


def shift_scale_m(coherence: MeanCoherence | None, *, width_m: float) -> float:
    """Return the scale a of the shift of a spot's curve, (10c), in metres."""
    if coherence is None:
        return USUAL_SHIFT_M
    narrow_m = SHIFT_M + INCOHERENT_SHIFT_M * (1 - coherence.mean) + SCATTER_SHIFT_M * coherence.scatter
    return narrow_m * math.sqrt(width_m / USUAL_WIDTH_M)


def shifted_density(
    angle_deg: Float64[np.ndarray, " centres"],
    share: Float64[np.ndarray, " centres"],
    markers_deg: Float64[np.ndarray, " angles"],
    *,
    probability: float,
    scale_deg: float,
) -> Float64[np.ndarray, " angles"]:
    """Return the density of the marker's angle, (10), from the probabilities of the centre of its curve.

    ``angle_deg``, ``share``: centres of the curve in degrees, evenly spaced, and the probability of each.
    ``markers_deg``: angles of the marker at which the density is wanted. ``probability``: u: probability that the
    marker is a spot. ``scale_deg``: scale of the shift if it is.
    """
    step_deg = float(angle_deg[1] - angle_deg[0])
    # The convolution of (10) is a sum over the grid of centres, a few hundred by some dozens.
    same = np.interp(markers_deg, angle_deg, share / step_deg, left=0.0, right=0.0)
    square = 1 + ((markers_deg[:, None] - angle_deg) / scale_deg) ** 2 / 4
    # Student's density with four degrees of freedom is 3/8·square^(−5/2).
    shifted = 0.375 * square**-2.5 @ share / scale_deg
    return np.asarray((1 - probability) * same + probability * shifted)


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
