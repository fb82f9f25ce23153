"""The angles with the smallest bound for a marker at a known angle: no search can do better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.bounds.information import (
    NUISANCES,
    IntensityNoise,
    Nuisance,
    Prior,
    SlopedCurve,
    angle_bound_deg,
    sample_information,
)
from markerseek.core import PAPER_RANGE, ConfigError, Float64, Int64, Interval

STEP_DEG = 0.25
"""Step of the candidate angles, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BestAngles:
    """The best angles and their bound."""

    angles_deg: tuple[float, ...]
    """Angles, rising; the same angle may occur several times."""
    bound_deg: float
    """Least standard deviation of the marker's angle."""


def best_angles(
    curve: SlopedCurve,
    *,
    marker_deg: float,
    noise: IntensityNoise,
    acquisitions: int,
    limits: Interval = PAPER_RANGE,
    unknown: tuple[Nuisance, ...] = NUISANCES,
    prior: Prior | None = None,
    step_deg: float = STEP_DEG,
) -> BestAngles:
    """Return the best angles for a marker by coordinate exchange (Meyer and Nachtsheim, Technometrics 37, 60 (1995)).

    Each angle in turn moves to where the bound is least, until a round changes nothing.
    """
    if acquisitions < 1:
        raise ConfigError(f"best angles: acquisitions is {acquisitions}, at least 1 is needed")
    if not 0 < step_deg <= limits.width_deg:
        raise ConfigError(f"best angles: step_deg is {step_deg} deg, it must lie in (0, {limits.width_deg:g}] deg")
    angle_deg = np.linspace(limits.low_deg, limits.high_deg, round(limits.width_deg / step_deg) + 1)
    each = sample_information(curve, angle_deg, marker_deg=marker_deg, noise=noise)
    # With few samples the matrix is singular and every choice has an infinite bound: this small share of every
    # angle's information makes the first choices comparable. The returned bound is without it.
    hint = 1e-6 * each.mean(axis=0)
    # Start near the marker, where the information is.
    chosen = _spread(angle_deg, marker_deg, acquisitions)
    best = np.inf
    for _ in range(50):
        for place in range(acquisitions):
            # Information adds up: the other samples plus each candidate, all at once.
            others = each[np.delete(chosen, place)].sum(axis=0) + hint
            chosen[place] = int(np.argmin(angle_bound_deg(others + each, unknown=unknown, prior=prior)))
        now = float(angle_bound_deg(each[chosen].sum(axis=0) + hint, unknown=unknown, prior=prior))
        if not now < best * (1 - 1e-9):
            break
        best = now
    bound_deg = float(angle_bound_deg(each[chosen].sum(axis=0), unknown=unknown, prior=prior))
    return BestAngles(angles_deg=tuple(sorted(angle_deg[chosen].tolist())), bound_deg=bound_deg)


def _spread(angle_deg: Float64[np.ndarray, " angles"], marker_deg: float, count: int) -> Int64[np.ndarray, " count"]:
    """Indices of the initial angles, spread about the marker."""
    offsets = np.linspace(-6.0, 6.0, count) if count > 1 else np.array([2.0])
    return np.asarray(np.abs(angle_deg[:, None] - marker_deg - offsets).argmin(axis=0), dtype=np.int64)
