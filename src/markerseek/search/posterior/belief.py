"""What is known of the angle, as numbers: a posterior on an even grid, and markers drawn from it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core.shapes import Float64, Int64


def spread(angle_deg: Float64[np.ndarray, " angles"], share: Float64[np.ndarray, " angles"]) -> tuple[float, float]:
    """Mean and standard deviation on an even grid, its step in it."""
    mean_deg = float(share @ angle_deg)
    step_deg = float(angle_deg[1] - angle_deg[0])
    return mean_deg, math.sqrt(float(share @ (angle_deg - mean_deg) ** 2) + step_deg**2 / 12)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Belief:
    """The posterior of the angle.

    Attributes
    ----------
    angle_deg, share
        Angles in degrees, evenly spaced, and the probability of each; they add up to 1.
    coarse_deg, coarse_share
        The same over the whole range.
    theta_deg, member, log_snr
        Markers of equal weight drawn from it: angle in degrees, shape, ln of the amplitude over σ.
    loud_deg, loud_log_snr
        Samples from which the curve is known to be even: angle in degrees, ln of the intensity over σ; none where it
        is not known yet.
    fwhm_deg
        Mean of the curve's full width at half maximum, in degrees.
    marker_m
        Lateral position of the marker in metres; None while no sample is clear of the noise.
    middle_sigma_deg
        Standard deviation of the middle of the curve: what more samples can still reduce.
    """

    angle_deg: Float64[np.ndarray, " angles"]
    share: Float64[np.ndarray, " angles"]
    coarse_deg: Float64[np.ndarray, " coarse"]
    coarse_share: Float64[np.ndarray, " coarse"]
    theta_deg: Float64[np.ndarray, " particles"]
    member: Int64[np.ndarray, " particles"]
    log_snr: Float64[np.ndarray, " particles"]
    loud_deg: Float64[np.ndarray, " loud"]
    loud_log_snr: Float64[np.ndarray, " loud"]
    fwhm_deg: float
    marker_m: float | None
    middle_sigma_deg: float

    @property
    def mean_deg(self) -> float:
        """Mean of the angle in degrees."""
        return float(self.share @ self.angle_deg)

    @property
    def sigma_deg(self) -> float:
        """Standard deviation of the angle in degrees, the step of the grid in it."""
        return spread(self.angle_deg, self.share)[1]

    def quantile_deg(self, probability: float) -> float:
        """Angle below which the marker lies with that probability, in degrees."""
        step_deg = float(self.angle_deg[1] - self.angle_deg[0])
        edges = np.concatenate([[0.0], np.cumsum(self.share)])
        ends = np.concatenate([self.angle_deg - step_deg / 2, self.angle_deg[-1:] + step_deg / 2])
        return float(np.interp(probability, edges, ends))
