"""Compiled kernel of the next angle: the variance expected of a sample (11)."""

from __future__ import annotations

import math

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float64, Int64
from markerseek.search.posterior._symmetry import log_level, template_sigma


@compiled
def _variance_left(
    theta_deg: Float64[np.ndarray, " particles"],
    height: Float64[np.ndarray, " particles"],
    variance: Float64[np.ndarray, " particles"],
    sums: Float64[np.ndarray, "3 particles"],
) -> float:
    """Mean of (11): each marker in turn is the truth, the others keep the weight that its sample would leave them."""
    count = theta_deg.size
    sums[0], sums[1], sums[2] = 1.0, 0.0, 0.0
    mass, mean, square = sums[0], sums[1], sums[2]
    # Weights are the same both ways: half of the pairs are enough.
    for p in range(count):
        own_mass, own_mean, own_square = 0.0, 0.0, 0.0
        for other in range(p + 1, count):
            away = (height[p] - height[other]) ** 2 / (variance[p] + variance[other])
            # (1 + d²/8)⁻⁴ for exp(−d²/2): without a call the loop runs in vector registers, and for far markers its
            # heavier tail leaves a little weight, as an outlier would.
            near_by = 1 / (1 + away / 8)
            near_by *= near_by
            near_by *= near_by
            offset = theta_deg[other] - theta_deg[p]
            own_mass += near_by
            own_mean += near_by * offset
            own_square += near_by * offset * offset
            mass[other] += near_by
            mean[other] -= near_by * offset
            square[other] += near_by * offset * offset
        mass[p] += own_mass
        mean[p] += own_mean
        square[p] += own_square
    total = 0.0
    for p in range(count):
        total += square[p] / mass[p] - (mean[p] / mass[p]) ** 2
    return total / count


@compiled
def expected_variance(
    candidates_deg: Float64[np.ndarray, " candidates"],
    theta_deg: Float64[np.ndarray, " particles"],
    member: Int64[np.ndarray, " particles"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    log_amplitude: Float64[np.ndarray, " particles"],
    step_deg: float,
    floor: float,
    strong_deg: Float64[np.ndarray, " strong"],
    strong_log: Float64[np.ndarray, " strong"],
    length_deg: Float64[np.ndarray, " shapes"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    sample_error: float,
    out: Float64[np.ndarray, " candidates"],
) -> None:
    """Expected variance of the angle after one more sample at each candidate, in deg²; amplitudes in units of σ.

    ``strong_deg`` and ``strong_log`` are the strong samples of a symmetric curve: the template's error at the nearest
    of them, by its distance from a marker, is expected of the candidate too.
    """
    count, strong = theta_deg.size, strong_deg.size
    distance, residual = np.empty((count, strong)), np.empty((count, strong))
    for p in range(count):
        for i in range(strong):
            away_deg = abs(strong_deg[i] - theta_deg[p])
            level = log_level(log_curve[member[p]], away_deg / step_deg)
            distance[p, i] = away_deg / length_deg[member[p]]
            residual[p, i] = (strong_log[i] - log_amplitude[p] - level) / template_sigma(level, log_levels, sigmas)
    height, variance, sums = np.empty(count), np.empty(count), np.empty((3, count))
    for c in range(candidates_deg.size):
        for p in range(count):
            away_deg = abs(candidates_deg[c] - theta_deg[p])
            level = log_level(log_curve[member[p]], away_deg / step_deg)
            sigma, place = template_sigma(level, log_levels, sigmas), away_deg / length_deg[member[p]]
            # Of (8) only the most correlated strong sample: its residual, shrunk by the correlation, is expected here.
            correlation, expected = 0.0, 0.0
            for i in range(strong):
                known = 1 / (1 + 0.5 * (distance[p, i] - place) ** 2)
                if known > correlation:
                    correlation, expected = known, known * residual[p, i] * sigma
            mu = math.exp(min(log_amplitude[p] + level + expected, 300.0))
            # Below the noise floor the largest peak stays as high as the floor: such candidates give no information.
            height[p] = 0.5 * math.log(mu * mu + floor * floor)
            variance[p] = (
                sigma * sigma * (1 - correlation * correlation)
                + sample_error * sample_error
                + 1 / (mu * mu + floor * floor)
            )
        out[c] = _variance_left(theta_deg, height, variance, sums)
