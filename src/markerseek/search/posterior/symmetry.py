"""Likelihood for a symmetric elevation curve: a Gaussian process over |t| models the template's error.

No real curve is of the family (`shapes`): on a flank it is 10 to 30 % off. Taken as an error of each sample by itself,
that hides the angle. But the curve of a point is symmetric, whatever its form: the error at the distance |t| from the
marker is the same on either side, and nearly the same at a distance a little larger. So

    ln y_i = ln A + ln S(t_i) + g(|t_i|) + e_i,                                                                (7)
    cov(g, g') = s·s'/(1 + (|t| − |t'|)²/(2 (ℓF)²)),                                                           (8)

with g a Gaussian process over |t| whose standard deviation s grows towards the tails (Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, 2.7: the amplitude under a flat prior; 4.19: the rational quadratic kernel), and e
a sample's own error: noise, and the laser's energy. Any one sample may be an outlier: by its density given all the
others (5.10 to 5.12 there), which costs nothing more. Samples too weak for a normal ln y, and those from another
lateral position, count by their table (3) as before.

It is computed about the angle that a finer grid has found, and replaces the grid's answer (`inference`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Int64
from markerseek.search.posterior import _symmetry
from markerseek.search.posterior.grid import ERRORS, LEVELS
from markerseek.search.posterior.likelihood import (
    OUTLIER_RANGE,
    OUTLIER_SHARE,
    PEAK_NOISE,
    TABLE_LOW,
    TABLE_SIZE,
    TABLE_STEP,
    Observation,
    log_tables,
)
from markerseek.search.posterior.shapes import STEP_DEG, Shapes

TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS = np.log([1.0, 0.6, 0.3, 0.05]), np.array([0.035, 0.12, 0.27, 0.35])
"""Standard deviation s of g where ln S has these levels, downwards; linear in between."""

CORRELATION_LENGTH = 0.2
"""Distance ℓ over which g is correlated, over the full width at half maximum."""

SAMPLE_ERRORS: tuple[tuple[float, float], ...] = ((0.01, 0.7), (0.03, 0.22), (0.1, 0.08))
"""Relative errors e of one sample by itself, the laser's energy, and the prior probability of each."""

STRONG_SNR = 8.0
"""Intensity over σ from which ln y is normal."""

LEAST_STRONG, MOST_STRONG = 3, 16
"""Strong samples that are needed, and the most that are used, the strongest first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """Hypotheses about the curve: a shape, and the relative error of one sample by itself.

    Attributes
    ----------
    member
        Shapes, as indices into the family; each may stand with several errors.
    sample_error
        Relative error of one sample by itself.
    log_prior
        ln of the prior probability.
    """

    member: Int64[np.ndarray, " hypotheses"]
    sample_error: Float64[np.ndarray, " hypotheses"]
    log_prior: Float64[np.ndarray, " hypotheses"]

    def kept(self, which: Int64[np.ndarray, " kept"]) -> Hypotheses:
        """Only those of these indices."""
        return Hypotheses(
            member=self.member[which], sample_error=self.sample_error[which], log_prior=self.log_prior[which]
        )


def hypotheses_of(shapes: Shapes, members: Int64[np.ndarray, " members"]) -> Hypotheses:
    """Return these shapes, each with all of `SAMPLE_ERRORS`."""
    sample_error, share = np.repeat(np.array(SAMPLE_ERRORS), members.size, axis=0).T
    member = np.tile(members, len(SAMPLE_ERRORS))
    return Hypotheses(member=member, sample_error=sample_error, log_prior=shapes.log_prior[member] + np.log(share))


def strong_observations(observations: Sequence[Observation]) -> list[Observation]:
    """Return the strong observations at the marker's lateral position, strongest first, `MOST_STRONG` at most."""
    order = sorted(observations, key=lambda observation: observation.noise)
    return [each for each in order if each.noise <= 1 / STRONG_SNR and each.lateral_ratio >= 1][:MOST_STRONG]


def symmetric_log_likelihood(
    shapes: Shapes,
    hypotheses: Hypotheses,
    observations: Sequence[Observation],
    angles_deg: Float64[np.ndarray, " angles"],
) -> tuple[Float64[np.ndarray, "angles hypotheses"], Float64[np.ndarray, "angles hypotheses"]]:
    """Return ln p of all observations for each angle and hypothesis, and the ln amplitude that goes with it.

    Parameters
    ----------
    shapes
        Family of curves.
    hypotheses
        Shapes and errors that are considered.
    observations
        All observations, at least `LEAST_STRONG` of them strong.
    angles_deg
        Angles of the marker that are considered, in degrees.
    """
    strong = strong_observations(observations)
    # By identity: two observations of one angle may be equal.
    weak = [each for each in observations if not any(each is other for other in strong)]
    errors = tuple(ERRORS.tolist())
    tables = np.empty((len(weak), ERRORS.size, TABLE_SIZE))
    for row, each in zip(tables, weak, strict=True):
        row[:] = log_tables(noise=each.noise, cells=each.cells, errors=errors, ratio=each.lateral_ratio)
    log_p = np.empty((angles_deg.size, hypotheses.member.size))
    log_amplitude = np.empty_like(log_p)
    _symmetry.symmetric_likelihood(
        angles_deg,
        hypotheses.member,
        shapes.log_curve,
        shapes.fwhm_deg,
        STEP_DEG,
        np.array([each.angle_deg for each in strong + weak]),
        np.array([each.log_intensity for each in strong + weak]),
        PEAK_NOISE * np.array([each.noise for each in strong]),
        hypotheses.sample_error,
        TEMPLATE_LOG_LEVELS,
        TEMPLATE_SIGMAS,
        CORRELATION_LENGTH,
        OUTLIER_SHARE / OUTLIER_RANGE,
        tables,
        LEVELS,
        TABLE_LOW,
        TABLE_STEP,
        log_p,
        log_amplitude,
    )
    return log_p, log_amplitude
