"""The posterior of the centre of the curve: finer and finer grids, and the likelihood of a symmetric curve (7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from markerseek.core import Float64, Int64
from markerseek.search.posterior.grid import Grid, Marginals, Particles, finer, mean_and_sigma
from markerseek.search.posterior.likelihood import Observation
from markerseek.search.posterior.shapes import Shapes
from markerseek.search.posterior.symmetry import (
    MIN_STRONG,
    PULSE_ERRORS,
    SAMPLE_ERRORS,
    USUAL_PULSE_ERROR,
    USUAL_SAMPLE_ERROR,
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
    fit: Fit | None = None
    """What the symmetric likelihood was computed with; None where it was not."""
    moved_sigma_deg: float = 0.0
    """As of `AnglePosterior`."""
    measured_again: bool = False
    """As of `AnglePosterior`."""
    centre_sigma_deg: float | None = None
    """Standard deviation of the centre over the places of a marker that moves; None: that of ``probability``."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """What a symmetric likelihood was computed with."""

    shapes: Shapes
    at_rest: Hypotheses
    """Shapes with the errors of samples of a marker that rests."""
    moving: Hypotheses
    """The same shapes with those of one that moves in depth."""
    samples: Grouped
    log_prior: LogDensity


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

MIN_SHARE = 0.01
"""Probability of a hypothesis, over that of the most probable, below which it is dropped in between."""

HALF_WIDTH_SIGMAS = 5.0
"""Half the width of the next finer grid, in standard deviations."""

MOVED_ERRORS: tuple[tuple[float, float], ...] = ((0.02, 0.45), (0.08, 0.35), (0.25, 0.2))
"""Relative errors of one sample of a marker that moves, and the prior probability of each. An average of pulses is
blurred: a marker that moves in depth by half a wavelength meanwhile, some 0.1 mm, loses a part of its height."""


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
        hypotheses = hypotheses.kept(np.flatnonzero(by_hypothesis > MIN_SHARE * by_hypothesis.max()))
    sample_error = float(weight.sum(axis=0) @ hypotheses.sample_error / weight.sum())
    of_each_width = _of_each_width(shapes, grid, best)
    row, column = drawn_cells(weight, particles)
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
        fit=Fit(
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


def drawn_cells(
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
