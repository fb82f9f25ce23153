"""The posterior of the marker's angle as numbers: probabilities on an even grid, particles, moments, modes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Int64, Interval

MODE_PROBABILITY = 0.05
"""Probability from which a second peak of the posterior is a mode."""


def mean_and_sigma(
    angle_deg: Float64[np.ndarray, " angles"], probability: Float64[np.ndarray, " angles"]
) -> tuple[float, float]:
    """Mean and standard deviation on an even grid, the width of its step included."""
    mean_deg = float(probability @ angle_deg)
    step_deg = float(angle_deg[1] - angle_deg[0])
    return mean_deg, math.sqrt(float(probability @ (angle_deg - mean_deg) ** 2) + step_deg**2 / 12)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AnglePosterior:
    """The posterior of the angle."""

    angle_deg: Float64[np.ndarray, " angles"]
    probability: Float64[np.ndarray, " angles"]
    """``angle_deg`` and ``probability``: angles in degrees, evenly spaced, and the probability of each; they add up to
    1."""
    coarse_deg: Float64[np.ndarray, " coarse"]
    coarse_probability: Float64[np.ndarray, " coarse"]
    """``coarse_deg`` and ``coarse_probability``: the same over the whole range."""
    sigma: float
    """Noise over which amplitudes are stated, in the unit of the intensities."""
    theta_deg: Float64[np.ndarray, " particles"]
    member: Int64[np.ndarray, " particles"]
    log_snr: Float64[np.ndarray, " particles"]
    """``theta_deg``, ``member`` and ``log_snr``: markers of equal weight drawn from it: angle in degrees, shape, ln of
    the amplitude over σ."""
    strong_deg: Float64[np.ndarray, " strong"]
    strong_log_snr: Float64[np.ndarray, " strong"]
    strong_samples: Int64[np.ndarray, " strong"]
    """``strong_deg``, ``strong_log_snr`` and ``strong_samples``: groups of samples to which a symmetric curve was
    fitted: angle in degrees, ln of the intensity over σ, number of samples; none where too few are strong."""
    energy_gain: float | None
    """What the amplitude of a spot's energy is multiplied by to be as high as the peak at the top of the curve; None
    where the curve is that of the peak."""
    sample_error: float
    """Relative error of one sample by itself, the laser's energy."""
    fwhm_deg: float
    """Mean of the curve's full width at half maximum."""
    marker_m: float | None
    """Lateral position of the marker; None while no sample is clear of the noise."""
    centre_sigma_deg: float
    """Standard deviation of the centre of the curve: what more samples can still reduce."""

    @property
    def mean_deg(self) -> float:
        """Mean of the angle in degrees."""
        return float(self.probability @ self.angle_deg)

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of the angle in degrees, the width of the grid's step included."""
        return mean_and_sigma(self.angle_deg, self.probability)[1]

    def quantile_deg(self, probability: float) -> float:
        """Angle below which the marker lies with that probability, in degrees."""
        return float(np.interp(probability, *self._steps()))

    def cumulative(self, angles_deg: Float64[np.ndarray, " ends"]) -> Float64[np.ndarray, " ends"]:
        """Probability with which the marker lies below each angle, in degrees."""
        probability, ends_deg = self._steps()
        return np.asarray(np.interp(angles_deg, ends_deg, probability))

    def _steps(self) -> tuple[Float64[np.ndarray, " ends"], Float64[np.ndarray, " ends"]]:
        """Cumulative probability at the ends of the steps; each probability is uniform over one step of the grid."""
        step_deg = float(self.angle_deg[1] - self.angle_deg[0])
        ends_deg = np.concatenate([self.angle_deg - step_deg / 2, self.angle_deg[-1:] + step_deg / 2])
        return np.concatenate([[0.0], np.cumsum(self.probability)]), ends_deg


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
