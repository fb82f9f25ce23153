"""The likelihood of samples whose curve is even, compiled."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core.compiled import compiled
from markerseek.core.shapes import Float64, Int64


@compiled
def log_level(log_curve: Float64[np.ndarray, " distances"], place: float) -> float:
    """Ln S at so many steps from the marker."""
    near = min(int(place), log_curve.size - 2)
    part = min(place - near, 1.0)
    return float((1 - part) * log_curve[near] + part * log_curve[near + 1])


@compiled
def stray_of(height: float, levels: Float64[np.ndarray, " levels"], strays: Float64[np.ndarray, " levels"]) -> float:
    """Standard deviation of g where ln of the curve is ``height``: one of ``strays`` at each of ``levels``."""
    if height >= levels[0]:
        return float(strays[0])
    for row in range(1, levels.size):
        if height >= levels[row]:
            part = (levels[row - 1] - height) / (levels[row - 1] - levels[row])
            return float(strays[row - 1] + part * (strays[row] - strays[row - 1]))
    return float(strays[-1])


@compiled
def _covariance(
    height: Float64[np.ndarray, " loud"],
    place: Float64[np.ndarray, " loud"],
    variance: Float64[np.ndarray, " loud"],
    levels: Float64[np.ndarray, " levels"],
    strays: Float64[np.ndarray, " levels"],
    out: Float64[np.ndarray, "loud loud"],
) -> None:
    """Fill in the lower half: s_i·s_k/(1 + (x_i − x_k)²/2), and each sample's own variance on the diagonal."""
    count = height.size
    stray = np.empty(count)
    for i in range(count):
        stray[i] = stray_of(height[i], levels, strays)
        for k in range(i):
            apart = place[i] - place[k]
            out[i, k] = stray[i] * stray[k] / (1 + 0.5 * apart * apart)
        out[i, i] = stray[i] ** 2 + variance[i]


@compiled
def _factor_and_invert(matrix: Float64[np.ndarray, "n n"], inverse: Float64[np.ndarray, "n n"]) -> float:
    """Cholesky's factor in place of the lower half, and its inverse; returns ln of the determinant."""
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
    spoilt: float,
    unit: Float64[np.ndarray, " n"],
    whitened: Float64[np.ndarray, " n"],
) -> tuple[float, float]:
    """Ln p of values with an unknown common offset, one of them perhaps spoilt; and that offset.

    ``inverse`` is that of Cholesky's factor L; ``unit`` and ``whitened`` are workspace.
    """
    count = value.size
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
        # Precision and residual of one value given the others, the offset integrated out.
        precision = 0.0
        for c in range(i, count):
            precision += inverse[c, i] ** 2
        precision = max(precision - unit[i] ** 2 / total, 1e-9)
        weighted = whitened[i] - offset * unit[i]
        square += weighted * value[i]
        bad += math.sqrt(2 * math.pi / precision) * math.exp(min(0.5 * weighted**2 / precision, 500.0))
    log_density = -0.5 * (square + log_determinant + math.log(total) + (count - 1) * math.log(2 * math.pi))
    return log_density + math.log1p(spoilt * bad), offset


@compiled
def even_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    members: Int64[np.ndarray, " members"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    fwhm_deg: Float64[np.ndarray, " shapes"],
    step_deg: float,
    heard_deg: Float64[np.ndarray, " samples"],
    log_intensity: Float64[np.ndarray, " samples"],
    noise: Float64[np.ndarray, " loud"],
    own: Float64[np.ndarray, " members"],
    levels: Float64[np.ndarray, " levels"],
    strays: Float64[np.ndarray, " levels"],
    length: float,
    spoilt: float,
    tables: Float64[np.ndarray, "faint errors heights"],
    table_levels: Float64[np.ndarray, " errors"],
    table_low: float,
    table_step: float,
    out: Float64[np.ndarray, "angles members"],
    log_amplitude: Float64[np.ndarray, "angles members"],
) -> None:
    """Fill in ln p of all samples for each angle and shape, and the ln amplitude that goes with it.

    ``own`` is the error of a sample by itself that goes with each shape; a shape may come twice. The loud samples come
    first and count by `_log_density`, the others by their table at the amplitude of those.
    """
    samples, loud = heard_deg.size, noise.size
    level, place, value, variance = np.empty(samples), np.empty(loud), np.empty(loud), np.empty(loud)
    matrix, inverse = np.empty((loud, loud)), np.empty((loud, loud))
    unit, whitened = np.empty(loud), np.empty(loud)
    heights = tables.shape[2]
    for k in range(angles_deg.size):
        for j in range(members.size):
            member = members[j]
            for i in range(samples):
                distance = abs(heard_deg[i] - angles_deg[k])
                level[i] = log_level(log_curve[member], distance / step_deg)
                if i < loud:
                    place[i] = distance / (length * fwhm_deg[member])
                    value[i] = log_intensity[i] - level[i]
                    variance[i] = noise[i] ** 2 + own[j] ** 2
            _covariance(level[:loud], place, variance, levels, strays, matrix)
            log_determinant = _factor_and_invert(matrix, inverse)
            log_p, amplitude = _log_density(inverse, log_determinant, value, spoilt, unit, whitened)
            for i in range(loud, samples):
                row = 0
                while level[i] < table_levels[row]:
                    row += 1
                height = (amplitude + level[i] - log_intensity[i] - table_low) / table_step
                log_p += tables[i - loud, row, min(max(int(height + 0.5), 0), heights - 1)]
            out[k, j], log_amplitude[k, j] = log_p, amplitude
