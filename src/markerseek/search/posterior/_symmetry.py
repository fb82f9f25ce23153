"""Compiled kernels of the symmetric curve: its likelihood (7) to (9), and the variance expected of a sample (11)."""

from __future__ import annotations

import math

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float64, Int64


@compiled
def log_level(log_curve: Float64[np.ndarray, " distances"], steps: float) -> float:
    """Ln S at this number of steps from the marker, linear between the tabulated ones."""
    near = min(int(steps), log_curve.size - 2)
    part = min(steps - near, 1.0)
    return float((1 - part) * log_curve[near] + part * log_curve[near + 1])


@compiled
def template_sigma(
    level: float, log_levels: Float64[np.ndarray, " levels"], sigmas: Float64[np.ndarray, " levels"]
) -> float:
    """Standard deviation s of g where ln S is ``level``: one of ``sigmas`` at each of ``log_levels``."""
    if level >= log_levels[0]:
        return float(sigmas[0])
    for row in range(1, log_levels.size):
        if level >= log_levels[row]:
            part = (log_levels[row - 1] - level) / (log_levels[row - 1] - log_levels[row])
            return float(sigmas[row - 1] + part * (sigmas[row] - sigmas[row - 1]))
    return float(sigmas[-1])


@compiled
def _covariance(
    level: Float64[np.ndarray, " strong"],
    distance: Float64[np.ndarray, " strong"],
    variance: Float64[np.ndarray, " strong"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    out: Float64[np.ndarray, "strong strong"],
) -> None:
    """Fill in the lower half of (8), ``distance`` in units of ℓF, and each sample's own variance on the diagonal."""
    count = level.size
    sigma = np.empty(count)
    for i in range(count):
        sigma[i] = template_sigma(level[i], log_levels, sigmas)
        for k in range(i):
            apart = distance[i] - distance[k]
            out[i, k] = sigma[i] * sigma[k] / (1 + 0.5 * apart * apart)
        out[i, i] = sigma[i] ** 2 + variance[i]


@compiled
def factor_and_invert(matrix: Float64[np.ndarray, "n n"], inverse: Float64[np.ndarray, "n n"]) -> float:
    """Cholesky's factor in place of the lower half, and its inverse; returns ln of the determinant."""
    # 3 to 8 times as fast as LAPACK through Numba for 3 to 16 samples (`benchmarks.kernels`): its calls allocate, and
    # the matrices are small. A decision makes some 300 of them.
    count = matrix.shape[0]
    determinant = 1.0
    for i in range(count):
        for k in range(i + 1):
            rest = matrix[i, k]
            for c in range(k):
                rest -= matrix[i, c] * matrix[k, c]
            if i == k:
                matrix[i, i] = math.sqrt(rest)
                determinant *= rest
            else:
                matrix[i, k] = rest / matrix[k, k]
        inverse[i, i] = 1 / matrix[i, i]
        for k in range(i):
            total = 0.0
            for c in range(k, i):
                total += matrix[i, c] * inverse[c, k]
            inverse[i, k] = -total * inverse[i, i]
    return math.log(determinant)


@compiled
def _log_density(
    inverse: Float64[np.ndarray, "n n"],
    log_determinant: float,
    value: Float64[np.ndarray, " n"],
    outlier: float,
    unit: Float64[np.ndarray, " n"],
    whitened: Float64[np.ndarray, " n"],
) -> tuple[float, float]:
    """Ln p of values with an unknown common offset ln A, one of them perhaps an outlier (9); and that offset.

    ``inverse`` is that of Cholesky's factor L; ``unit`` and ``whitened`` are workspace.
    """
    count = value.size
    # unit = C⁻¹·1 and whitened = C⁻¹·value, of C = L·Lᵀ. The offset under a flat prior is that of least squares,
    # 1ᵀC⁻¹value / 1ᵀC⁻¹1 (Rasmussen and Williams 2.7).
    unit[:] = 0.0
    whitened[:] = 0.0
    total, offset = 0.0, 0.0
    for c in range(count):
        one, known = 0.0, 0.0
        for k in range(c + 1):
            one += inverse[c, k]
            known += inverse[c, k] * value[k]
        total += one * one
        offset += one * known
        for k in range(c + 1):
            unit[k] += one * inverse[c, k]
            whitened[k] += known * inverse[c, k]
    offset /= total
    square, bad = 0.0, 0.0
    for i in range(count):
        # Precision and residual of one value given the others, the offset integrated out (there 5.12): p without it
        # is p over its density given the others, so that leaving each one out takes no second factorisation.
        precision = 0.0
        for c in range(i, count):
            precision += inverse[c, i] ** 2
        precision = max(precision - unit[i] ** 2 / total, 1e-9)
        weighted = whitened[i] - offset * unit[i]
        square += weighted * value[i]
        # Beyond exp(500) the sum would overflow; such a value is an outlier in any case.
        bad += math.sqrt(2 * math.pi / precision) * math.exp(min(0.5 * weighted**2 / precision, 500.0))
    log_density = -0.5 * (square + log_determinant + math.log(total) + (count - 1) * math.log(2 * math.pi))
    return log_density + math.log1p(outlier * bad), offset


@compiled
def symmetric_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    members: Int64[np.ndarray, " members"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    fwhm_deg: Float64[np.ndarray, " shapes"],
    step_deg: float,
    measured_deg: Float64[np.ndarray, " samples"],
    log_intensity: Float64[np.ndarray, " samples"],
    noise: Float64[np.ndarray, " strong"],
    sample_error: Float64[np.ndarray, " members"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    length: float,
    outlier: float,
    tables: Float64[np.ndarray, "weak errors entries"],
    table_levels: Float64[np.ndarray, " errors"],
    table_low: float,
    table_step: float,
    out: Float64[np.ndarray, "angles members"],
    log_amplitude: Float64[np.ndarray, "angles members"],
) -> None:
    """Fill in ln p of all samples for each angle and shape, and the ln amplitude that goes with it.

    ``sample_error`` goes with each shape; a shape may come twice. The strong samples come first and count by
    `_log_density`, the others by their table at the amplitude of those.
    """
    samples, strong = measured_deg.size, noise.size
    level, distance, value, variance = np.empty(samples), np.empty(strong), np.empty(strong), np.empty(strong)
    matrix, inverse = np.empty((strong, strong)), np.empty((strong, strong))
    unit, whitened = np.empty(strong), np.empty(strong)
    entries = tables.shape[2]
    for k in range(angles_deg.size):
        for j in range(members.size):
            member = members[j]
            for i in range(samples):
                away_deg = abs(measured_deg[i] - angles_deg[k])
                level[i] = log_level(log_curve[member], away_deg / step_deg)
                if i < strong:
                    distance[i] = away_deg / (length * fwhm_deg[member])
                    value[i] = log_intensity[i] - level[i]
                    # ln y of a strong sample is normal with the standard deviation σ/y.
                    variance[i] = noise[i] ** 2 + sample_error[j] ** 2
            _covariance(level[:strong], distance, variance, log_levels, sigmas, matrix)
            log_determinant = factor_and_invert(matrix, inverse)
            log_p, amplitude = _log_density(inverse, log_determinant, value, outlier, unit, whitened)
            for i in range(strong, samples):
                row = 0
                while level[i] < table_levels[row]:
                    row += 1
                entry = (amplitude + level[i] - log_intensity[i] - table_low) / table_step
                log_p += tables[i - strong, row, min(max(int(entry + 0.5), 0), entries - 1)]
            out[k, j], log_amplitude[k, j] = log_p, amplitude


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
            # Below the noise floor the largest peak stays as high as the floor: such candidates tell nothing.
            height[p] = 0.5 * math.log(mu * mu + floor * floor)
            variance[p] = (
                sigma * sigma * (1 - correlation * correlation)
                + sample_error * sample_error
                + 1 / (mu * mu + floor * floor)
            )
        out[c] = _variance_left(theta_deg, height, variance, sums)
