"""The posterior of the angle, and its modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Int64, Interval
from markerseek.search.posterior.grid import mean_and_sigma
from markerseek.search.posterior.motion import TurnMotion
from markerseek.search.posterior.shapes import STEP_DEG, family


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
    measured_again: bool = False
    """Whether an angle was measured at two times, so that a motion along the turn would have been seen."""

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
