"""How tissue moves over time: its period, its swing and its direction, and the pause in which it may be measured.

A ventilated patient breathes every two to eight seconds and pauses at the end of exhalation. The displacement is fitted
with a few harmonics of one period that all three axes share (the multiharmonic periodogram: Schwarzenberg-Czerny,
Astrophys. J. 460, 1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from markerseek.core import Float64, Matrix, Vector, as_matrix, as_vector

PERIODS_S = (2.0, 8.0)
"""Shortest and longest period."""

MIN_PERIODS = 1.6
"""Fewest periods of a series in which a period is looked for."""

MIN_SWING_MM = 0.1
"""Least swing that is called a motion."""

MIN_EXPLAINED = 0.6
"""Least share of the variance that one period explains."""

_HARMONICS = 4
_PHASES = 200
_SIGMAS = 4.0
"""Least swing that is called a motion, in its standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DisplacementSeries:
    """Displacements of tissue since a reference, in the left camera's frame."""

    at_s: Float64[np.ndarray, " times"]
    """Times, rising."""
    displacements_m: Float64[np.ndarray, "times 3"]
    covariances_m2: Float64[np.ndarray, "times 3 3"]


class TissueMoves(msgspec.Struct, frozen=True, kw_only=True, tag="tissue-moves"):
    """The tissue around the spot goes to and fro."""

    from_s: float
    until_s: float
    """``from_s`` and ``until_s``: first and last time of the series."""
    rest_mm: Vector
    """Displacement at the end where it stays longest, the end of exhalation, since the reference."""
    swing_mm: Vector
    """Displacement from that end to the other one."""
    covariance_mm2: Matrix
    """Covariance of the swing."""
    period_s: float | None
    """Time of a cycle; None if it has none."""
    period_sigma_s: float | None
    pause_at_s: float | None
    """Begin of a pause, in which the tissue stays near its rest; None without a period."""
    pause_s: float
    """Length of a pause."""

    @property
    def amplitude_mm(self) -> float:
        """Half of the swing: the tissue moves by ± this much."""
        return math.hypot(*self.swing_mm) / 2

    @property
    def breaths(self) -> float:
        """How many breaths were seen; 0 without a period."""
        return 0.0 if self.period_s is None else (self.until_s - self.from_s) / self.period_s

    @property
    def direction(self) -> Vector:
        """Direction of the swing, of length 1."""
        x, y, z = self.swing_mm
        length = 2 * self.amplitude_mm
        return x / length, y / length, z / length

    def in_pause(self, at_s: float) -> bool:
        """Return whether the tissue stays near its rest at a time, as far as it goes on as it did."""
        if self.period_s is None or self.pause_at_s is None:
            return False
        return (at_s - self.pause_at_s) % self.period_s <= self.pause_s


def tissue_motion(series: DisplacementSeries, *, gate_mm: float = 0.2) -> TissueMoves | None:
    """Return how tissue moves; None if it does not, by more than its measurements scatter.

    ``gate_mm``: how far from its rest the tissue may be in a pause.
    """
    moved_mm = 1e3 * series.displacements_m
    if len(moved_mm) < 2 * _HARMONICS + 4:
        return None
    noise_mm2 = 1e6 * np.median(series.covariances_m2, axis=0)
    fit = _best_period(series.at_s, moved_mm)
    if fit is None:
        return _without_period(series.at_s, moved_mm, noise_mm2)
    profile = _profile(_PHASES) @ fit.coefficients
    # The direction is that of the largest variance of the cycle.
    direction = np.linalg.svd(profile - profile.mean(axis=0), full_matrices=False)[2][0]
    along = (profile - profile.mean(axis=0)) @ direction
    if np.mean(along > 0.5 * (along.max() + along.min())) > 0.5:
        along = -along
    rest = int(np.argmin(along))
    other = int(np.argmax(along))
    difference = _profile(_PHASES)[other] - _profile(_PHASES)[rest]
    covariance = float(difference @ fit.inverse @ difference) * fit.residual_mm2
    swing = profile[other] - profile[rest]
    if not _is_motion(swing, covariance):
        # Seen in a part of each breath only, its cycle is open; that it moved is not.
        return _without_period(series.at_s, moved_mm, noise_mm2)
    near = along - along.min() <= gate_mm
    begin, length = _longest(near, rest)
    return TissueMoves(
        from_s=float(series.at_s[0]),
        until_s=float(series.at_s[-1]),
        rest_mm=as_vector(profile[rest]),
        swing_mm=as_vector(swing),
        covariance_mm2=as_matrix(covariance),
        period_s=fit.period_s,
        period_sigma_s=fit.period_sigma_s,
        pause_at_s=float(series.at_s[0]) + begin / _PHASES * fit.period_s,
        pause_s=length / _PHASES * fit.period_s,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    period_s: float
    period_sigma_s: float
    coefficients: Float64[np.ndarray, "terms 3"]
    inverse: Float64[np.ndarray, "terms terms"]
    """Inverse normal matrix of mean and harmonics."""
    residual_mm2: Float64[np.ndarray, "3 3"]
    """Covariance of the residuals."""


def _best_period(at_s: Float64[np.ndarray, " times"], moved_mm: Float64[np.ndarray, "times 3"]) -> _Fit | None:
    """Fit the period that explains most; None if none explains enough."""
    span_s = float(at_s[-1] - at_s[0])
    longest_s = min(PERIODS_S[1], span_s / MIN_PERIODS)
    if longest_s <= PERIODS_S[0]:
        return None
    drift = ((at_s - at_s.mean()) / span_s)[:, None]
    without_period = np.concatenate([np.ones((len(at_s), 1)), drift], axis=1)
    whole = float(np.sum(_least_squares(without_period, moved_mm)[1] ** 2))
    # A tenth of the width of a peak.
    step_hz = 0.1 / span_s
    rates_hz = np.arange(1 / longest_s, 1 / PERIODS_S[0], step_hz)
    sums = np.array([float(np.sum(_least_squares(_terms(at_s, drift, rate), moved_mm)[1] ** 2)) for rate in rates_hz])
    best = float(sums.min())
    if whole <= 0 or 1 - best / whole < MIN_EXPLAINED:
        return None
    # Multiples of the period explain as much: the shortest one that does is taken.
    good = np.flatnonzero(sums <= best + 0.1 * (whole - best))
    last = int(good[-1])
    group = good[good >= last - int(0.1 * last) - 2]
    at = int(group[np.argmin(sums[group])])
    rate_hz = float(rates_hz[at])
    curvature = 0.0
    if 0 < at < len(sums) - 1:
        curvature = float(sums[at - 1] - 2 * sums[at] + sums[at + 1])
        if curvature > 0:
            rate_hz += step_hz * 0.5 * float(sums[at - 1] - sums[at + 1]) / curvature
    terms = _terms(at_s, drift, rate_hz)
    coefficients, residuals = _least_squares(terms, moved_mm)
    freedom = max(1, len(at_s) - terms.shape[1])
    residual_mm2 = residuals.T @ residuals / freedom
    variance = float(np.trace(residual_mm2)) / 3
    sigma_hz = step_hz * math.sqrt(2 * variance / curvature) if curvature > 0 else step_hz
    # The drift is not part of a cycle.
    kept = [0, *range(2, terms.shape[1])]
    return _Fit(
        period_s=1 / rate_hz,
        period_sigma_s=sigma_hz / rate_hz**2,
        coefficients=coefficients[kept],
        inverse=np.linalg.pinv(terms.T @ terms)[np.ix_(kept, kept)],
        residual_mm2=residual_mm2,
    )


def _terms(
    at_s: Float64[np.ndarray, " times"], drift: Float64[np.ndarray, "times 1"], rate_hz: float
) -> Float64[np.ndarray, "times terms"]:
    """Return the mean, drift, and harmonics of a rate."""
    phase = 2 * np.pi * rate_hz * (at_s - at_s[0])
    harmonics = _harmonics(phase)
    return np.concatenate([np.ones((len(at_s), 1)), drift, harmonics], axis=1)


def _harmonics(phase: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, "times terms"]:
    orders = np.arange(1, _HARMONICS + 1)
    angles = phase[:, None] * orders
    return np.concatenate([np.cos(angles), np.sin(angles)], axis=1)


def _profile(phases: int) -> Float64[np.ndarray, "phases terms"]:
    """Return the mean and harmonics over one cycle."""
    return np.concatenate([np.ones((phases, 1)), _harmonics(2 * np.pi * np.arange(phases) / phases)], axis=1)


def _least_squares(
    terms: Float64[np.ndarray, "times terms"], moved_mm: Float64[np.ndarray, "times 3"]
) -> tuple[Float64[np.ndarray, "terms 3"], Float64[np.ndarray, "times 3"]]:
    """Return the coefficients of a least squares fit, and its residuals."""
    coefficients = np.linalg.lstsq(terms, moved_mm, rcond=None)[0]
    return coefficients, moved_mm - terms @ coefficients


def _without_period(
    at_s: Float64[np.ndarray, " times"],
    moved_mm: Float64[np.ndarray, "times 3"],
    noise_mm2: Float64[np.ndarray, "3 3"],
) -> TissueMoves | None:
    """Return a motion that does not repeat: from the densest place to the end of 95 % of all."""
    middle = np.median(moved_mm, axis=0)
    direction = np.linalg.svd(moved_mm - moved_mm.mean(axis=0), full_matrices=False)[2][0]
    along = (moved_mm - middle) @ direction
    low, high = np.quantile(along, [0.05, 0.95])
    rest, other = (low, high) if -low <= high else (high, low)
    swing = (other - rest) * direction
    covariance = 2 * noise_mm2
    # What scatters from time to time as its covariances let expect is no motion.
    if not _is_motion(swing, covariance):
        return None
    return TissueMoves(
        from_s=float(at_s[0]),
        until_s=float(at_s[-1]),
        rest_mm=as_vector(middle + rest * direction),
        swing_mm=as_vector(swing),
        covariance_mm2=as_matrix(covariance),
        period_s=None,
        period_sigma_s=None,
        pause_at_s=None,
        pause_s=0.0,
    )


def _is_motion(swing_mm: Float64[np.ndarray, " 3"], covariance_mm2: Float64[np.ndarray, "3 3"]) -> bool:
    length_mm = float(np.linalg.norm(swing_mm))
    if length_mm < MIN_SWING_MM:
        return False
    direction = swing_mm / length_mm
    return length_mm > _SIGMAS * math.sqrt(float(direction @ covariance_mm2 @ direction))


def _longest(near: np.ndarray, rest: int) -> tuple[int, int]:
    """Return begin and length of the phases around the rest that are near it, which may go over the end of a cycle."""
    count = len(near)
    if near.all():
        return 0, count
    begin = rest
    while near[(begin - 1) % count]:
        begin -= 1
    end = rest
    while near[(end + 1) % count]:
        end += 1
    return begin, end - begin
