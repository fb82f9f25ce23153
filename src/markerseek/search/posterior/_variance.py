"""The variance that one more sample is expected to leave, compiled."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64, Int64

from markerseek.core.compiled import compiled


@compiled
def expected_variance(
    candidates_deg: Float64[np.ndarray, " candidates"],
    theta_deg: Float64[np.ndarray, " particles"],
    member: Int64[np.ndarray, " particles"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    log_amplitude: Float64[np.ndarray, " particles"],
    step_deg: float,
    floor: float,
    levels: Float64[np.ndarray, " errors"],
    errors: Float64[np.ndarray, " errors"],
    out: Float64[np.ndarray, " candidates"],
) -> None:
    """Expected variance of the angle after one more sample at each candidate, in deg²; amplitudes in units of σ."""
    count = theta_deg.size
    height = np.empty(count)
    spread = np.empty(count)
    mass, mean, square = np.empty(count), np.empty(count), np.empty(count)
    distances = log_curve.shape[1]
    for c in range(candidates_deg.size):
        for p in range(count):
            place = abs(candidates_deg[c] - theta_deg[p]) / step_deg
            near = min(int(place), distances - 2)
            part = min(place - near, 1.0)
            level = (1 - part) * log_curve[member[p], near] + part * log_curve[member[p], near + 1]
            row = 0
            while level < levels[row]:
                row += 1
            mu = math.exp(min(log_amplitude[p] + level, 300.0))
            height[p] = 0.5 * math.log(mu * mu + floor * floor)
            spread[p] = errors[row] ** 2 + 1 / (mu * mu + floor * floor)
        mass[:], mean[:], square[:] = 1.0, 0.0, 0.0
        for p in range(count):
            own_mass, own_mean, own_square = 0.0, 0.0, 0.0
            for other in range(p + 1, count):
                away = (height[p] - height[other]) ** 2 / (spread[p] + spread[other])
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
        out[c] = total / count
