"""What the hand-written numerics of the posterior gain over a library's call: ``python -m benchmarks.kernels``.

Each pair computes the same numbers, in turns on one core; the ratio is the median over the turns. The library's call
runs where it can: compiled by Numba (LAPACK, `math.exp`, `np.exp`), or as SciPy's on a whole array.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from scipy.special import i0e, ndtr

from benchmarks import machine
from markerseek.search.posterior.likelihood import TABLE_HIGH, TABLE_LOW, TABLE_STEP, _fill_tables
from markerseek.search.posterior.symmetry import factor_and_invert

TURNS = 31
TURN_S = 0.01
"""Turns of each pair, and least seconds of one turn."""

_FASTMATH = {"nsz", "arcp", "contract", "reassoc"}
_factor_and_invert = factor_and_invert


@njit(fastmath=_FASTMATH)
def _ours_cholesky(matrix: np.ndarray, work: np.ndarray, inverse: np.ndarray) -> float:
    work[:] = matrix
    return _factor_and_invert(work, inverse)


@njit(fastmath=_FASTMATH)
def _lapack_cholesky(matrix: np.ndarray, work: np.ndarray, inverse: np.ndarray) -> float:
    work[:] = np.linalg.cholesky(matrix)
    inverse[:] = np.linalg.inv(work)
    return 2 * np.log(np.diag(work)).sum()


def _pairs() -> dict[str, tuple[Callable[[], object], Callable[[], object]]]:
    rng = np.random.default_rng(1)
    mu = np.exp(np.arange(TABLE_LOW, TABLE_HIGH + TABLE_STEP / 2, TABLE_STEP))
    errors = np.array([0.035, 0.1, 0.2])
    table = np.empty((3, mu.size))

    def scipy_table() -> np.ndarray:
        variance = 0.02**2 + (errors[:, None] * mu) ** 2
        density = np.exp(-((1 - mu) ** 2) / (2 * variance)) / variance * i0e(mu / variance)
        return np.log(density * 0.9 + 0.1 * ndtr((1 - mu) / np.sqrt(variance)) + 0.0014)

    def covariance(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        root = rng.normal(size=(n, n))
        return root @ root.T + np.eye(n), np.empty((n, n)), np.zeros((n, n))

    pairs: dict[str, tuple[Callable[[], object], Callable[[], object]]] = {
        "table of (3) over SciPy's i0e and ndtr": (
            lambda: _fill_tables(mu, 0.02, 0.9, 0.1, 0.0014, errors, table),
            scipy_table,
        ),
    }
    for n in (3, 8, 16):
        cube = covariance(n)
        pairs[f"Cholesky and inverse, {n} × {n}, over LAPACK"] = (
            lambda cube=cube: _ours_cholesky(*cube),  # type: ignore[misc]
            lambda cube=cube: _lapack_cholesky(*cube),  # type: ignore[misc]
        )
    return pairs


def main() -> None:
    """Measure, and print one line for each pair."""
    machine.hold_to_cores(1)
    for name, value in machine.describe(cores=1).items():
        print(f"- {name}: {value}")
    print("\n| kernel | ours, µs | library, µs | library over ours |\n| --- | --- | --- | --- |")
    for name, (ours, library) in _pairs().items():
        ours(), library()
        began_s = time.perf_counter()
        library()
        count = max(1, math.ceil(TURN_S / max(time.perf_counter() - began_s, 1e-6)))
        times = [(_seconds(ours, count), _seconds(library, count)) for _ in range(TURNS)]
        mine_s, theirs_s = (statistics.median(column) for column in zip(*times, strict=True))
        ratio = statistics.median(theirs / mine for mine, theirs in times)
        print(f"| {name} | {1e6 * mine_s:.2f} | {1e6 * theirs_s:.2f} | {ratio:.2g} |")


def _seconds(call: Callable[[], object], count: int) -> float:
    began_s = time.perf_counter()
    for _ in range(count):
        call()
    return (time.perf_counter() - began_s) / count


if __name__ == "__main__":
    main()
