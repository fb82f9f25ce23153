"""Sums over the grid of angle, shape and amplitude, compiled."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float32, Float64, Int64

from markerseek.core.compiled import compiled


@compiled
def add_sample(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    angles_deg: Float64[np.ndarray, " angles"],
    members: Int64[np.ndarray, " members"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    step_deg: float,
    angle_deg: float,
    tables: Float32[np.ndarray, "errors phases heights"],
    levels: Float64[np.ndarray, " errors"],
    first: float,
    table_step: float,
) -> None:
    """Add ln p of one sample to each cell.

    ``first`` is ln(lowest amplitude / y) − LOW. A cell's height in the table is that plus ln S plus its amplitude.
    """
    amplitudes = cube.shape[2]
    phases, heights = tables.shape[1], tables.shape[2]
    distances = log_curve.shape[1]
    for k in range(angles_deg.size):
        place = abs(angle_deg - angles_deg[k]) / step_deg
        near = min(int(place), distances - 2)
        part = min(place - near, 1.0)
        for j in range(members.size):
            curve = log_curve[members[j]]
            level = (1 - part) * curve[near] + part * curve[near + 1]
            row = 0
            while level < levels[row]:
                row += 1
            start = math.floor((first + level) / table_step + 0.5)
            shift, phase = start // phases, start % phases
            table = tables[row, phase]
            low = min(max(0, -shift), amplitudes)
            high = max(low, min(amplitudes, heights - shift))
            # Slices that begin at 0 run in vector registers.
            below, inside, above = cube[k, j, :low], cube[k, j, low:high], cube[k, j, high:]
            known = table[low + shift : high + shift]
            for a in range(below.size):
                below[a] += table[0]
            for a in range(inside.size):
                inside[a] += known[a]
            for a in range(above.size):
                above[a] += table[heights - 1]


@compiled
def weigh(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    log_angle: Float64[np.ndarray, " angles"],
    log_shape: Float64[np.ndarray, " shapes"],
    weight: Float32[np.ndarray, "angles shapes amplitudes"],
    by_angle: Float64[np.ndarray, " angles"],
    by_shape: Float64[np.ndarray, " shapes"],
    by_amplitude: Float64[np.ndarray, " amplitudes"],
) -> float:
    """Fill in the weights (zero before) and their marginals; return ln of the largest before scaling."""
    angles, shapes, amplitudes = cube.shape
    tops = np.empty((angles, shapes))
    largest = -math.inf
    for k in range(angles):
        for j in range(shapes):
            cell = cube[k, j]
            top = cell[0]
            for a in range(amplitudes):
                if cell[a] > top:
                    top = cell[a]
            tops[k, j] = log_angle[k] + log_shape[j] + top
            largest = max(largest, tops[k, j])
    by_angle[:] = 0
    by_shape[:] = 0
    by_amplitude[:] = 0
    least = np.float32(-18.0)
    for k in range(angles):
        for j in range(shapes):
            if tops[k, j] - largest < least:
                continue
            base = np.float32(log_angle[k] + log_shape[j] - largest)
            total = 0.0
            for a in range(amplitudes):
                value = cube[k, j, a] + base
                if value > least:
                    share = math.exp(value)
                    weight[k, j, a] = share
                    total += share
                    by_amplitude[a] += share
            by_angle[k] += total
            by_shape[j] += total
    return largest


@compiled
def draw(
    weight: Float32[np.ndarray, "angles shapes amplitudes"],
    by_angle: Float64[np.ndarray, " angles"],
    place: Int64[np.ndarray, "particles 3"],
) -> int:
    """Pick cells at even steps of the cumulative weight; return how many were picked."""
    angles, shapes, amplitudes = weight.shape
    total = 0.0
    for k in range(angles):
        total += by_angle[k]
    count = place.shape[0]
    step = total / count
    target = step / 2
    heap = 0.0
    picked = 0
    for k in range(angles):
        if heap + by_angle[k] < target:
            heap += by_angle[k]
            continue
        for j in range(shapes):
            for a in range(amplitudes):
                heap += weight[k, j, a]
                while picked < count and heap > target:
                    place[picked, 0], place[picked, 1], place[picked, 2] = k, j, a
                    picked += 1
                    target += step
    return picked


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
        total = 0.0
        for p in range(count):
            mass, mean, square = 0.0, 0.0, 0.0
            for other in range(count):
                away = (height[p] - height[other]) ** 2 / (spread[p] + spread[other])
                near_by = 1 / (1 + away / 8)
                near_by *= near_by
                near_by *= near_by
                offset = theta_deg[other] - theta_deg[p]
                mass += near_by
                mean += near_by * offset
                square += near_by * offset * offset
            total += square / mass - (mean / mass) ** 2
        out[c] = total / count
