"""What a real curve strays by on one flank it strays by on the other: the angle from both.

No real curve is of the family (`shapes`): on a flank it is 10 to 30 % off. Taken as an error of each sample by itself,
that hides the angle. But the curve of a point is even, whatever its form: an error at the distance |t| from the marker
is the same on either side, and nearly the same at a distance a little larger. So

    ln y_i = ln A + ln S(t_i) + g(|t_i|) + e_i,      cov(g, g') = s·s'/(1 + (|t| − |t'|)²/(2 (ℓF)²)),

with g a Gaussian process over |t| whose standard deviation s grows towards the tails (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, 2.7: the amplitude under a flat prior; 4.19: the rational quadratic kernel), and e
a sample's own: noise, and the laser's energy. Any one sample may be spoilt: by its density given all the others (5.10
to 5.12 there), which costs nothing more. Samples too faint for a normal ln y, and those from another place along the
array, count by their table (`heard`) as before.

It is worked out about the place where a finer grid has found the marker, and replaces its answer (`narrow`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core.shapes import Float64, Int64
from markerseek.search.posterior import _even
from markerseek.search.posterior.grid import ERRORS, LEVELS, Heard
from markerseek.search.posterior.heard import HEIGHTS, LOW, SPOILT, SPOILT_RANGE, STEP, log_tables
from markerseek.search.posterior.shapes import STEP_DEG, Shapes

LOG_LEVELS, STRAYS = np.log([1.0, 0.6, 0.3, 0.05]), np.array([0.03, 0.1, 0.25, 0.3])
"""Standard deviation s of g where ln of a member over its peak is so much, downwards; linear in between."""

LENGTH = 0.2
"""Distance ℓ over which g keeps its sign, over the full width at half maximum."""

OWN: tuple[tuple[float, float], ...] = ((0.015, 0.6), (0.04, 0.3), (0.15, 0.1))
"""Relative errors of one sample by itself, the laser's energy, and the prior share of each."""

LOUD = 8.0
"""Intensity over σ from which ln y is normal."""

LEAST_LOUD, MOST_LOUD = 3, 16
"""Loud samples that it takes, and the loudest that are taken."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kinds:
    """Kinds of curve: a shape, and how far a sample strays by itself.

    Attributes
    ----------
    member
        Shapes, as places in the family; each may come with several errors.
    own
        Relative error of one sample by itself.
    log_prior
        ln of the prior probability.
    """

    member: Int64[np.ndarray, " kinds"]
    own: Float64[np.ndarray, " kinds"]
    log_prior: Float64[np.ndarray, " kinds"]

    def kept(self, which: Int64[np.ndarray, " kept"]) -> Kinds:
        """Only some of them."""
        return Kinds(member=self.member[which], own=self.own[which], log_prior=self.log_prior[which])


def kinds_of(shapes: Shapes, members: Int64[np.ndarray, " members"]) -> Kinds:
    """Return these shapes, each with all of `OWN`."""
    own, share = np.repeat(np.array(OWN), members.size, axis=0).T
    member = np.tile(members, len(OWN))
    return Kinds(member=member, own=own, log_prior=shapes.log_prior[member] + np.log(share))


def loud_ones(samples: Sequence[Heard]) -> list[Heard]:
    """Return the loud samples from the marker's place, the loudest first, `MOST_LOUD` at most."""
    order = sorted(samples, key=lambda heard: heard.noise)
    return [heard for heard in order if heard.noise <= 1 / LOUD and heard.ratio >= 1][:MOST_LOUD]


def even_log_likelihood(
    shapes: Shapes, kinds: Kinds, samples: Sequence[Heard], angles_deg: Float64[np.ndarray, " angles"]
) -> tuple[Float64[np.ndarray, "angles kinds"], Float64[np.ndarray, "angles kinds"]]:
    """Return ln p of all samples for each angle and kind of curve, and the ln amplitude that goes with it.

    Parameters
    ----------
    shapes
        Family of curves.
    kinds
        Kinds of curve that are considered.
    samples
        All samples, at least `LEAST_LOUD` of them loud.
    angles_deg
        Angles of the marker that are considered, in degrees.
    """
    loud = loud_ones(samples)
    faint = [heard for heard in samples if not any(heard is other for other in loud)]
    errors = tuple(ERRORS.tolist())
    tables = np.empty((len(faint), ERRORS.size, HEIGHTS))
    for row, heard in zip(tables, faint, strict=True):
        row[:] = log_tables(noise=heard.noise, cells=heard.cells, errors=errors, ratio=heard.ratio)
    log_p = np.empty((angles_deg.size, kinds.member.size))
    log_amplitude = np.empty_like(log_p)
    _even.even_likelihood(
        angles_deg,
        kinds.member,
        shapes.log_curve,
        shapes.fwhm_deg,
        STEP_DEG,
        np.array([heard.angle_deg for heard in loud + faint]),
        np.array([heard.log_intensity for heard in loud + faint]),
        np.array([heard.noise for heard in loud]),
        kinds.own,
        LOG_LEVELS,
        STRAYS,
        LENGTH,
        SPOILT / SPOILT_RANGE,
        tables,
        LEVELS,
        LOW,
        STEP,
        log_p,
        log_amplitude,
    )
    return log_p, log_amplitude
