"""Compiled kernels of the grid: the table of (3), and sums over angle, shape and amplitude."""

from __future__ import annotations

import math

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Bool, Float32, Float64, Int32, Int64

DROPPED_BELOW = 30.0
"""Log-likelihood below the largest from which a row of the grid is dropped: three outliers could not bring it back."""

MIN_LOG_WEIGHT = np.float32(-18.0)
"""Ln of a cell's weight over the largest from which it counts."""

_PER_OCTAVE, _OCTAVE, _BIAS = np.float32(1 / math.log(2)), np.float32(math.log(2)), np.float32(127)
_ONE, _HALF, _SIXTH, _24TH, _120TH = (np.float32(1 / math.factorial(order)) for order in range(1, 6))


@compiled
def fill_tables(
    mu: Float64[np.ndarray, " entries"],
    noise: float,
    below: float,
    largest: float,
    outlier: float,
    errors: Float64[np.ndarray, " errors"],
    out: Float64[np.ndarray, "errors entries"],
) -> None:
    """Fill in (3) at y = 1: ln(f_R(1|μ)·below + largest·Φ((1 − μ)/σ) + outlier), σ² = noise² + (εμ)².

    The Rician density f_R is exp(−(1 − μ)²/2σ²)/σ²·exp(−x)·I₀(x), x = μ/σ²: by its series for small x and the first
    terms of its expansion for large ones (Abramowitz and Stegun 9.6.12, 9.7.1), to 1e-4. 3 to 10 times as fast as
    SciPy's i0e and ndtr on the whole table (`benchmarks.kernels`), of which most densities are 0.
    """
    for row in range(errors.size):
        for k in range(mu.size):
            variance = noise**2 + (errors[row] * mu[k]) ** 2
            away = (1 - mu[k]) ** 2 / (2 * variance)
            density = 0.0
            # Beyond exp(−40) the outliers' density is all that is left.
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
            # F_R of (3): the marker's own envelope stays below a noise peak of height 1.
            reached = 0.5 * math.erfc((mu[k] - 1) / math.sqrt(2 * variance))
            out[row, k] = math.log(density * below + largest * reached + outlier)


@compiled
def add_sample(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    alive: Bool[np.ndarray, "angles shapes"],
    angles_deg: Float64[np.ndarray, " angles"],
    members: Int64[np.ndarray, " members"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    step_deg: float,
    angle_deg: float,
    tables: Float32[np.ndarray, "errors phases entries"],
    levels: Float64[np.ndarray, " errors"],
    first: float,
    table_step: float,
) -> None:
    """Add ln p of one observation to each cell of the rows that are alive.

    ``first`` is ln(lowest amplitude / y) − TABLE_LOW. A cell's place in the table is that plus ln S plus its amplitude.
    The tables are extended at either end by as many entries as there are amplitudes, so that every row lies inside.
    """
    amplitudes = cube.shape[2]
    phases, entries = tables.shape[1], tables.shape[2]
    distances = log_curve.shape[1]
    for k in range(angles_deg.size):
        # Linear interpolation in the tabulated ln S, once for all shapes.
        steps = abs(angle_deg - angles_deg[k]) / step_deg
        near = min(int(steps), distances - 2)
        part = min(steps - near, 1.0)
        for j in range(members.size):
            if not alive[k, j]:
                continue
            member = members[j]
            level = (1 - part) * log_curve[member, near] + part * log_curve[member, near + 1]
            # The model error ε of (3) grows from the top of the curve to its tails: a table for each level.
            row = 0
            while level < levels[row]:
                row += 1
            start = math.floor((first + level) / table_step + 0.5)
            entry = math.floor((start + 0.5) / phases)
            shift = min(max(entry + amplitudes, 0), entries - amplitudes)
            # Amplitudes step by whole entries of one phase, so that a row is a sum of two slices: no lookup per cell,
            # and slices that begin at 0 run in vector registers.
            cells, known = cube[k, j], tables[row, start - entry * phases, shift : shift + amplitudes]
            for a in range(amplitudes):
                cells[a] += known[a]


@compiled
def _survey(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    alive: Bool[np.ndarray, "angles shapes"],
    log_angle: Float64[np.ndarray, " angles"],
    log_shape: Float64[np.ndarray, " shapes"],
    power: float,
    tops: Float64[np.ndarray, "angles shapes"],
) -> float:
    """Fill in the largest of each row, and drop the rows far below it; return the largest of all."""
    angles, shapes, amplitudes = cube.shape
    # The prior of the angle is part of what is compared with `MIN_LOG_WEIGHT` in `weigh`, not of what drops a row.
    tops[:] = -math.inf
    largest, best = -math.inf, -math.inf
    for k in range(angles):
        for j in range(shapes):
            if not alive[k, j]:
                continue
            cells = cube[k, j]
            top = cells[0]
            for a in range(amplitudes):
                top = max(top, cells[a])
            tops[k, j] = log_angle[k] + log_shape[j] + power * top
            largest = max(largest, tops[k, j])
            best = max(best, power * top + log_shape[j])
    # Without the prior of the angle, which the moments of arrival still change.
    for k in range(angles):
        for j in range(shapes):
            if tops[k, j] - log_angle[k] < best - DROPPED_BELOW:
                alive[k, j] = False
    return largest


@compiled
def exponential(
    log: Float32[np.ndarray, " cells"],
    series: Float32[np.ndarray, " cells"],
    bits: Int32[np.ndarray, " cells"],
    out: Float32[np.ndarray, " cells"],
) -> None:
    """Exp(log), and 0 from `MIN_LOG_WEIGHT` down, in vector registers: to 1e-5.

    2 to a whole power is written as the bits of ``out``, and Taylor's series of the rest, within ln 2 / 2 of 0, is
    multiplied on. 4 to 6 times as fast as Numba's np.exp, which is scalar in single precision, and as fast as NumPy's,
    which a kernel cannot call (`benchmarks.kernels`).
    """
    for a in range(log.size):
        value = max(log[a], MIN_LOG_WEIGHT)
        power = np.int32(value * _PER_OCTAVE + _BIAS + _HALF)
        rest = value - (np.float32(power) - _BIAS) * _OCTAVE
        bits[a] = power << np.int32(23)
        series[a] = _ONE + rest * (_ONE + rest * (_HALF + rest * (_SIXTH + rest * (_24TH + rest * _120TH))))
    for a in range(log.size):
        out[a] *= series[a] if log[a] > MIN_LOG_WEIGHT else np.float32(0)


@compiled
def weigh(
    cube: Float32[np.ndarray, "angles shapes amplitudes"],
    alive: Bool[np.ndarray, "angles shapes"],
    log_angle: Float64[np.ndarray, " angles"],
    log_shape: Float64[np.ndarray, " shapes"],
    power: float,
    weight: Float32[np.ndarray, "angles shapes amplitudes"],
    by_angle: Float64[np.ndarray, " angles"],
    by_shape: Float64[np.ndarray, " shapes"],
    by_amplitude: Float64[np.ndarray, " amplitudes"],
) -> float:
    """Fill in weights and marginals, of the likelihood to a ``power``; return ln of the largest before scaling.

    Rows that are `DROPPED_BELOW` below the largest, the prior of the angle left out, are dropped for good.
    """
    angles, shapes, amplitudes = cube.shape
    tops = np.empty((angles, shapes))
    largest = _survey(cube, alive, log_angle, log_shape, power, tops)
    by_angle[:] = 0
    by_shape[:] = 0
    by_amplitude[:] = 0
    # The rows that count are gathered first, so that the exponential runs over one long array for each angle.
    log, series = np.empty((shapes, amplitudes), np.float32), np.empty(shapes * amplitudes, np.float32)
    share = np.empty((shapes, amplitudes), np.float32)
    bits = share.reshape(-1).view(np.int32)
    counted = np.empty(shapes, np.int64)
    known_power = np.float32(power)
    for k in range(angles):
        count = 0
        for j in range(shapes):
            if tops[k, j] - largest >= MIN_LOG_WEIGHT:
                base, cells, row = np.float32(log_angle[k] + log_shape[j] - largest), cube[k, j], log[count]
                for a in range(amplitudes):
                    row[a] = known_power * cells[a] + base
                counted[count] = j
                count += 1
            else:
                weight[k, j] = 0
        size = count * amplitudes
        exponential(log.reshape(-1)[:size], series[:size], bits[:size], share.reshape(-1)[:size])
        for c in range(count):
            row, known = weight[k, counted[c]], share[c]
            total = np.float32(0)
            for a in range(amplitudes):
                row[a] = known[a]
                total += known[a]
                by_amplitude[a] += known[a]
            by_angle[k] += total
            by_shape[counted[c]] += total
    return largest


@compiled
def draw(
    weight: Float32[np.ndarray, "angles shapes amplitudes"],
    by_angle: Float64[np.ndarray, " angles"],
    cell: Int64[np.ndarray, "particles 3"],
) -> int:
    """Draw cells by systematic resampling, at equal steps of the cumulative weight; return how many were drawn."""
    # Without random numbers: the same samples always give the same particles, and so the same next angle.
    angles, shapes, amplitudes = weight.shape
    total = 0.0
    for k in range(angles):
        total += by_angle[k]
    count = cell.shape[0]
    step = total / count
    target = step / 2
    cumulative = 0.0
    drawn = 0
    for k in range(angles):
        # Most angles hold no target: their sum is skipped at once.
        if cumulative + by_angle[k] < target:
            cumulative += by_angle[k]
            continue
        for j in range(shapes):
            for a in range(amplitudes):
                cumulative += weight[k, j, a]
                while drawn < count and cumulative > target:
                    cell[drawn, 0], cell[drawn, 1], cell[drawn, 2] = k, j, a
                    drawn += 1
                    target += step
    return drawn
