"""The variance that one more sample is expected to leave, compiled."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core.compiled import compiled
from markerseek.core.shapes import Float64, Int64
from markerseek.search.posterior._even import log_level, stray_of


@compiled
def _variance_left(
    theta_deg: Float64[np.ndarray, " particles"],
    height: Float64[np.ndarray, " particles"],
    spread: Float64[np.ndarray, " particles"],
    sums: Float64[np.ndarray, "3 particles"],
) -> float:
    """Each marker in turn is the truth; the others keep the weight that a sample of its height would leave them."""
    count = theta_deg.size
    sums[0], sums[1], sums[2] = 1.0, 0.0, 0.0
    mass, mean, square = sums[0], sums[1], sums[2]
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
    heard_deg: Float64[np.ndarray, " heard"],
    heard_log: Float64[np.ndarray, " heard"],
    length_deg: Float64[np.ndarray, " shapes"],
    levels: Float64[np.ndarray, " levels"],
    strays: Float64[np.ndarray, " levels"],
    own: float,
    out: Float64[np.ndarray, " candidates"],
) -> None:
    """Expected variance of the angle after one more sample at each candidate, in deg²; amplitudes in units of σ.

    ``heard_deg`` and ``heard_log`` are the loud samples of an even curve: what the nearest of them, by its distance
    from a marker, strays by is expected of the candidate too.
    """
    count, loud = theta_deg.size, heard_deg.size
    far, strayed = np.empty((count, loud)), np.empty((count, loud))
    for p in range(count):
        for i in range(loud):
            distance = abs(heard_deg[i] - theta_deg[p])
            level = log_level(log_curve[member[p]], distance / step_deg)
            far[p, i] = distance / length_deg[member[p]]
            strayed[p, i] = (heard_log[i] - log_amplitude[p] - level) / stray_of(level, levels, strays)
    height, spread, sums = np.empty(count), np.empty(count), np.empty((3, count))
    for c in range(candidates_deg.size):
        for p in range(count):
            distance = abs(candidates_deg[c] - theta_deg[p])
            level = log_level(log_curve[member[p]], distance / step_deg)
            stray, place = stray_of(level, levels, strays), distance / length_deg[member[p]]
            alike, expected = 0.0, 0.0
            for i in range(loud):
                known = 1 / (1 + 0.5 * (far[p, i] - place) ** 2)
                if known > alike:
                    alike, expected = known, known * strayed[p, i] * stray
            mu = math.exp(min(log_amplitude[p] + level + expected, 300.0))
            height[p] = 0.5 * math.log(mu * mu + floor * floor)
            spread[p] = stray * stray * (1 - alike * alike) + own * own + 1 / (mu * mu + floor * floor)
        out[c] = _variance_left(theta_deg, height, spread, sums)
