"""The measured intensity curve S(θ), and its statistics: maximum, width, centres, limit by noise, scatter, quartile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Sample

KNEES: tuple[tuple[float, float, float], ...] = (
    (1.0, 2.0, 0.10),
    (1.2, 2.4, 0.26),
    (1.2, 5.0, 0.31),
    (1.6, 2.0, 0.15),
    (2.5, 2.0, 0.05),
    (math.inf, 2.0, 0.05),
)
"""Tail p, knee q, and prior share of each kind of smooth curve; p infinite is the Gaussian."""


def log_curve(
    distance_deg: Float64[np.ndarray, "*distances"], *, fwhm_deg: float, tail: float, knee: float
) -> Float64[np.ndarray, "*distances"]:
    """Return ln S of (1) of the posterior at distances from the marker.

    ``distance_deg``: distances t, of either sign. ``fwhm_deg``: full width at half maximum F. ``tail``, ``knee``:
    exponents p and q; p infinite is the Gaussian.
    """
    scaled = 2 * np.abs(distance_deg) / fwhm_deg
    if math.isinf(tail):
        return np.asarray(-math.log(2) * scaled**2)
    return np.asarray(-tail / knee * np.log1p((2 ** (knee / tail) - 1) * scaled**knee))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """Samples of S(θ) in ascending order of the angle."""

    angle_deg: Float64[np.ndarray, " samples"]
    """Angles reached, ascending; an angle may occur twice."""
    intensity: Float64[np.ndarray, " samples"]
    """Intensities at these angles, in the unit of the samples."""

    def __len__(self) -> int:
        return self.angle_deg.size

    @property
    def strongest(self) -> int:
        """Index of the largest intensity; of several, the one at the lowest angle."""
        return int(np.argmax(self.intensity))


def curve_of(samples: Sequence[Sample]) -> Curve:
    """Return the samples as a curve."""
    angle_deg = np.array([sample.angle_deg for sample in samples], dtype=np.float64)
    intensity = np.array([sample.reading.intensity for sample in samples], dtype=np.float64)
    order = np.argsort(angle_deg, kind="stable")
    return Curve(angle_deg=angle_deg[order], intensity=intensity[order])


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """What the highest peak of a curve looks like."""

    max_deg: float
    max_intensity: float
    """``max_deg`` and ``max_intensity``: angle of the largest sample in degrees, and its intensity."""
    com_deg: float
    """Centre of mass of what exceeds half of the maximum: over all samples, the noise of a wide scan would
    pull it to the middle of the angles. If all samples are zero, it is the mean of the angles."""
    cen_deg: float | None
    """Middle between the two crossings of half maximum; None if a side has none."""
    fwhm_deg: float | None
    """Full width at half maximum: the distance of the two crossings, or twice the distance from the maximum to the only
    one."""


def peak_of(curve: Curve, *, background: float = 0.0) -> Peak:
    """Return the statistics of the curve's highest peak; the curve holds one sample or more.

    ``background``: intensity above which heights count.
    """
    top = curve.strongest
    largest = float(curve.intensity[top])
    top_deg = float(curve.angle_deg[top])
    half = (largest + background) / 2
    weights = np.maximum(curve.intensity - half, 0.0) if largest > background else np.ones(len(curve))
    low_deg = _crossing_deg(curve, top, height=half, step=-1)
    high_deg = _crossing_deg(curve, top, height=half, step=1)
    cen_deg = None if low_deg is None or high_deg is None else (low_deg + high_deg) / 2
    if low_deg is not None and high_deg is not None:
        fwhm_deg: float | None = high_deg - low_deg
    elif low_deg is not None:
        fwhm_deg = 2 * (top_deg - low_deg)
    else:
        fwhm_deg = None if high_deg is None else 2 * (high_deg - top_deg)
    return Peak(
        max_deg=top_deg,
        max_intensity=largest,
        com_deg=float(np.average(curve.angle_deg, weights=weights)),
        cen_deg=cen_deg,
        fwhm_deg=fwhm_deg,
    )


def _crossing_deg(curve: Curve, top: int, *, height: float, step: int) -> float | None:
    """Return where a straight line between samples first crosses that height on that side of the top, in degrees."""
    if height == 0:
        return None
    index = top + step
    while 0 <= index < len(curve):
        inner = float(curve.intensity[index - step])
        outer = float(curve.intensity[index])
        if outer < height:
            share = (inner - height) / (inner - outer)
            inner_deg = float(curve.angle_deg[index - step])
            outer_deg = float(curve.angle_deg[index])
            return inner_deg + share * (outer_deg - inner_deg)
        index += step
    return None


def noise_limit_deg(curve: Curve, *, noise_sigma: float) -> float:
    """Return the least standard deviation in degrees of a maximum that is found by comparing samples.

    A peak of height A and full width at half maximum F that is near its top as a Gaussian, A·exp(−4 ln2 (t/F)²), has
    fallen by σ at t = F·sqrt(σ / (4 ln2 · A)). Nearer to the maximum one comparison is chance. In simulation, over
    widths of 3–17° and 30–40 dB, golden-section and ternary searches miss the maximum by a standard deviation of 0.40
    to 0.56 of t; 0.55·t is returned.

    ``curve``: the samples so far. ``noise_sigma``: standard deviation σ of the intensity, in the intensity's unit.
    """
    peak = peak_of(curve)
    width_deg = float(np.ptp(curve.angle_deg)) if peak.fwhm_deg is None else peak.fwhm_deg
    if peak.max_intensity <= noise_sigma:
        return width_deg
    return 0.55 * width_deg * math.sqrt(noise_sigma / (4 * math.log(2) * peak.max_intensity))


def scatter_of(curve: Curve) -> float:
    """Return the scatter of the samples about the line through both neighbours, as a standard deviation of one."""
    # 1.4826 turns a median into a standard deviation, and 1.5 is the variance with that of the two neighbours.
    low_deg = curve.angle_deg[:-2]
    middle_deg = curve.angle_deg[1:-1]
    high_deg = curve.angle_deg[2:]
    spaced = high_deg > low_deg
    share = (middle_deg - low_deg)[spaced] / (high_deg - low_deg)[spaced]
    # The line through both neighbours removes slope; a peak still bends, but the median ignores it.
    line = (1 - share) * curve.intensity[:-2][spaced] + share * curve.intensity[2:][spaced]
    return 1.4826 * float(np.median(np.abs(curve.intensity[1:-1][spaced] - line))) / math.sqrt(1.5)


def lower_quartile(curve: Curve) -> float:
    """Return the intensity below which a quarter of the measured range lies.

    Each sample represents the angles nearest to it.
    """
    # A search that converges takes most of its samples at the maximum; a plain quartile of those would be on the peak.
    edges = np.concatenate(
        [curve.angle_deg[:1], (curve.angle_deg[1:] + curve.angle_deg[:-1]) / 2, curve.angle_deg[-1:]]
    )
    share = np.diff(edges) / (edges[-1] - edges[0])
    order = np.argsort(curve.intensity, kind="stable")
    below = int(np.searchsorted(np.cumsum(share[order]), 0.25))
    return float(curve.intensity[order[min(below, len(curve) - 1)]])
