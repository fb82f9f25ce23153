"""Linear models with Student's errors, their coefficients integrated out, compiled."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core.compiled import compiled
from markerseek.core.shapes import Float64


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
