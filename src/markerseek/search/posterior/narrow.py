"""From the coarse grid to the middle of the curve: finer grids, and the two flanks together once both are loud."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core.shapes import Float64, Int64
from markerseek.search.posterior.belief import spread
from markerseek.search.posterior.even import LEAST_LOUD, even_log_likelihood, kinds_of, loud_ones
from markerseek.search.posterior.grid import Grid, Heard, Marginals, Markers, finer
from markerseek.search.posterior.shapes import Shapes

FINE_ANGLES = 33
"""Angles of a fine grid."""

EVEN_ANGLES = (13, 25)
"""Angles at which the flanks are compared: at first, and about what that leaves."""

EVEN_SHAPES = 8
"""Shapes with which they are compared, the likeliest."""

LEAST_SHARE = 0.01
"""Probability over the likeliest kind's below which a kind of curve is dropped in between."""

REACH = 5.0
"""Half the width of what is looked at more closely, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Middle:
    """The posterior of the middle of the curve.

    Attributes
    ----------
    angles_deg, share
        Angles in degrees, evenly spaced, and the probability of each; they add up to 1.
    markers
        Markers drawn from it.
    fwhm_deg
        Mean of the curve's full width at half maximum, in degrees.
    loud
        Samples whose flanks were compared; none if they could not be.
    """

    angles_deg: Float64[np.ndarray, " angles"]
    share: Float64[np.ndarray, " angles"]
    markers: Markers
    fwhm_deg: float
    loud: Sequence[Heard]

    @property
    def sigma_deg(self) -> float:
        """Standard deviation in degrees, the step of the angles in it."""
        return spread(self.angles_deg, self.share)[1]


def narrowed(
    shapes: Shapes,
    coarse: Grid,
    known: Marginals,
    samples: Sequence[Heard],
    else_known: Callable[[Float64[np.ndarray, " angles"]], Float64[np.ndarray, " angles"]],
    *,
    particles: int,
) -> Middle:
    """Return the posterior as finely as it is narrow.

    Parameters
    ----------
    shapes
        Family of curves.
    coarse, known
        The coarse grid and its probabilities.
    samples
        All samples; none, if only what is known beside the intensities counts: then the grid stays coarse.
    else_known
        Gives ln of what is known of each angle beside the intensities.
    particles
        Markers to draw.
    """
    grid, best = coarse, known
    loud = loud_ones(samples)
    both_flanks = len(loud) >= LEAST_LOUD
    for _ in range(1 if both_flanks else 2):
        half_deg = _half_deg(grid.angles_deg, best.angle)
        step_deg = float(grid.angles_deg[1] - grid.angles_deg[0])
        if not samples or half_deg >= 0.4 * (grid.angles_deg[-1] - grid.angles_deg[0]) / 2:
            break
        if grid is not coarse and step_deg <= 0.25 * half_deg / REACH:
            break
        grid = finer(shapes, grid, best, samples, half_deg=half_deg, angles=FINE_ANGLES)
        best = grid.marginals(else_known(grid.angles_deg), particles=particles)
    fwhm_deg = float(best.shape @ shapes.fwhm_deg[grid.members])
    if grid is coarse or not both_flanks:
        return Middle(angles_deg=grid.angles_deg, share=best.angle, markers=best.markers, fwhm_deg=fwhm_deg, loud=[])
    members = grid.members[np.sort(np.argsort(-best.shape, kind="stable")[:EVEN_SHAPES])]
    kinds = kinds_of(shapes, members)
    angles_deg, share = grid.angles_deg, best.angle
    for count in EVEN_ANGLES:
        half_deg = _half_deg(angles_deg, share)
        angles_deg = float(share @ angles_deg) + np.linspace(-half_deg, half_deg, count)
        log_p, log_amplitude = even_log_likelihood(shapes, kinds, samples, angles_deg)
        log_p += kinds.log_prior + else_known(angles_deg)[:, None]
        weight = np.exp(log_p - log_p.max())
        share = weight.sum(axis=1) / weight.sum()
        told, by_kind = kinds, weight.sum(axis=0)
        kinds = kinds.kept(np.flatnonzero(by_kind > LEAST_SHARE * by_kind.max()))
    row, kind = _drawn(weight, particles)
    markers = Markers(theta_deg=angles_deg[row], member=told.member[kind], log_amplitude=log_amplitude[row, kind])
    return Middle(angles_deg=angles_deg, share=share, markers=markers, fwhm_deg=fwhm_deg, loud=loud)


def _drawn(
    weight: Float64[np.ndarray, "angles kinds"], count: int
) -> tuple[Int64[np.ndarray, " drawn"], Int64[np.ndarray, " drawn"]]:
    """Angle and kind of cells at even steps of the cumulative weight."""
    heap = np.cumsum(weight)
    drawn = np.searchsorted(heap, heap[-1] * (np.arange(count) + 0.5) / count)
    row, kind = np.divmod(drawn, weight.shape[1])
    return row, kind


def _half_deg(angles_deg: Float64[np.ndarray, " angles"], share: Float64[np.ndarray, " angles"]) -> float:
    """Half the width of what is looked at more closely, in degrees."""
    step_deg = float(angles_deg[1] - angles_deg[0])
    return max(REACH * spread(angles_deg, share)[1], 2 * step_deg)
