"""Sums over the grid of angle, shape and amplitude, compiled."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from markerseek.core.compiled import compiled

HOPELESS = 30.0
"""Log-likelihood below the largest from which a place of the grid is given up."""


@compiled
def fill_tables(
    mu: Float64[np.ndarray, " heights"],
    noise: float,
    below: float,
    largest: float,
    spoilt: float,
    errors: Float64[np.ndarray, " errors"],
    out: Float64[np.ndarray, "errors heights"],
) -> None:
    """ln(f_R(1|μ)·below + largest·Φ((1 − μ)/σ) + spoilt), σ² = noise² + (εμ)².

    The Rician density f_R is exp(−(1 − μ)²/2σ²)/σ²·exp(−x)·I₀(x), x = μ/σ²: by its series for small x and the first
    terms of its expansion for large ones (Abramowitz and Stegun 9.6.12, 9.7.1), to 1e-4.
    """
    for row in range(errors.size):
        for k in range(mu.size):
            variance = noise**2 + (errors[row] * mu[k]) ** 2
            away = (1 - mu[k]) ** 2 / (2 * variance)
            density = 0.0
            if away < 40.0:
                x = mu[k] / variance
                if x > 8.0:
                    bessel = (1 + 0.125 / x * (1 + 0.5625 / x * (1 + 1.0416667 / x))) / math.sqrt(2 * math.pi * x)
                else:
                    term, total = 1.0, 1.0
                    for order in range(1, 24):
                        term *= (x / (2 * order)) ** 2
                        total += term
                    bessel = total * math.exp(-x)
                density = math.exp(-away) / variance * bessel
            reached = 0.5 * math.erfc((mu[k] - 1) / math.sqrt(2 * variance))
            out[row, k] = math.log(density * below + largest * reached + spoilt)


@compiled
def add_sample(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    alive: Bool[np.ndarray, "angles shapes"],
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
    """Add ln p of one sample to each cell that is alive.

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
            if not alive[k, j]:
                continue
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
def _give_up(
    alive: Bool[np.ndarray, "angles shapes"],
    tops: Float64[np.ndarray, "angles shapes"],
    log_angle: Float64[np.ndarray, " angles"],
    least: float,
) -> None:
    for k in range(tops.shape[0]):
        for j in range(tops.shape[1]):
            if tops[k, j] - log_angle[k] < least:
                alive[k, j] = False


@compiled
def weigh(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    alive: Bool[np.ndarray, "angles shapes"],
    log_angle: Float64[np.ndarray, " angles"],
    log_shape: Float64[np.ndarray, " shapes"],
    weight: Float32[np.ndarray, "angles shapes amplitudes"],
    by_angle: Float64[np.ndarray, " angles"],
    by_shape: Float64[np.ndarray, " shapes"],
    by_amplitude: Float64[np.ndarray, " amplitudes"],
) -> float:
    """Fill in the weights and their marginals; return ln of the largest before scaling.

    What is `HOPELESS` below the largest without the prior of the angle is given up: three bad frames in a row could not
    bring it back.
    """
    angles, shapes, amplitudes = cube.shape
    tops = np.full((angles, shapes), -math.inf)
    largest, best = -math.inf, -math.inf
    for k in range(angles):
        for j in range(shapes):
            if not alive[k, j]:
                continue
            top = cube[k, j].max()
            tops[k, j] = log_angle[k] + log_shape[j] + top
            largest = max(largest, tops[k, j])
            best = max(best, top + log_shape[j])
    _give_up(alive, tops, log_angle, best - HOPELESS)
    by_angle[:] = 0
    by_shape[:] = 0
    by_amplitude[:] = 0
    least = np.float32(-18.0)
    for k in range(angles):
        for j in range(shapes):
            row = weight[k, j]
            if tops[k, j] - largest < least:
                row[:] = 0
                continue
            base = np.float32(log_angle[k] + log_shape[j] - largest)
            total = 0.0
            for a in range(amplitudes):
                value = cube[k, j, a] + base
                share = math.exp(value) if value > least else 0.0
                row[a] = share
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


@compiled
def _solve(matrix: Float64[np.ndarray, "terms columns"], beta: Float64[np.ndarray, " terms"]) -> float:
    """Solve the symmetric system whose last column is its right side, by elimination; return half of ln of its det."""
    terms = beta.size
    half_log_det = 0.0
    for m in range(terms):
        half_log_det += 0.5 * math.log(matrix[m, m])
        for lower in range(m + 1, terms):
            part = matrix[lower, m] / matrix[m, m]
            for n in range(m, terms + 1):
                matrix[lower, n] -= part * matrix[m, n]
    for m in range(terms - 1, -1, -1):
        total = matrix[m, terms]
        for n in range(m + 1, terms):
            total -= matrix[m, n] * beta[n]
        beta[m] = total / matrix[m, m]
    return half_log_det


@compiled
def _misfit(
    design: Float64[np.ndarray, "samples terms"],
    value: Float64[np.ndarray, " samples"],
    scale: Float64[np.ndarray, " samples"],
    beta: Float64[np.ndarray, " terms"],
    out: Float64[np.ndarray, " samples"],
) -> None:
    for i in range(value.size):
        rest = value[i]
        for m in range(beta.size):
            rest -= design[i, m] * beta[m]
        out[i] = rest / scale[i]


@compiled
def student_evidence(
    design: Float64[np.ndarray, "angles samples terms"],
    value: Float64[np.ndarray, "angles samples"],
    scale: Float64[np.ndarray, "angles samples"],
    precision: Float64[np.ndarray, " terms"],
    freedom: float,
    rounds: int,
) -> Float64[np.ndarray, " angles"]:
    """Ln of the likelihood of value = design·β + scale·Student for each angle, β integrated out by Laplace's method.

    β has independent normal priors about 0. The mode is found by reweighted least squares.
    """
    angles, samples, terms = design.shape
    out = np.empty(angles)
    matrix = np.empty((terms, terms + 1))
    beta = np.zeros(terms)
    missed = np.empty(samples)
    for k in range(angles):
        missed[:] = 0.0
        half_log_det = 0.0
        for _ in range(rounds):
            matrix[:, :] = 0.0
            for m in range(terms):
                matrix[m, m] = precision[m]
            for i in range(samples):
                share = (freedom + 1) / (freedom + missed[i] ** 2) / scale[k, i] ** 2
                for m in range(terms):
                    matrix[m, terms] += share * design[k, i, m] * value[k, i]
                    for n in range(terms):
                        matrix[m, n] += share * design[k, i, m] * design[k, i, n]
            half_log_det = _solve(matrix, beta)
            _misfit(design[k], value[k], scale[k], beta, missed)
        log = -half_log_det
        for m in range(terms):
            log -= 0.5 * precision[m] * beta[m] ** 2
        for i in range(samples):
            log -= math.log(scale[k, i]) + (freedom + 1) / 2 * math.log1p(missed[i] ** 2 / freedom)
        out[k] = log
    return out
