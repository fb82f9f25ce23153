"""Detectability: how far from a marker a sample still detects it, and which markers a search may have missed.

A curve S of (1), the most common member of the family, is level/peak at the distance

    t = (F/2)·(((peak/level)^(q/p) − 1)/(2^(q/p) − 1))^(1/q).                                                 (12)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from markerseek.core import Interval, Sample
from markerseek.search.floor import SearchNoise

WEAKEST_DB = 20.0
"""Peak SNR of the weakest marker that a search is asked to find, in dB (physics notes: 20 to 60)."""

NARROW_DEG = 3.0
"""Full width at half maximum of the narrowest usual curve, in degrees (physics notes: 3 to 17)."""

USUAL_TAIL, USUAL_KNEE = 1.2, 2.4
"""Exponents p and q of (1) of the most common curve."""


def detection_distance_deg(*, level: float, peak: float, fwhm_deg: float) -> float:
    """Return the distance (12) at which the curve has fallen to the noise level, in degrees.

    ``level``, ``peak``: largest intensity that noise reaches, and intensity with the probe on the marker; 0 < level <
    peak. ``fwhm_deg``: full width at half maximum of the curve.
    """
    ratio = USUAL_KNEE / USUAL_TAIL
    scaled = ((peak / level) ** ratio - 1) / (2**ratio - 1)
    return fwhm_deg / 2 * math.pow(scaled, 1 / USUAL_KNEE)


def acquisitions_needed(limits: Interval, *, level: float, peak: float, fwhm_deg: float = NARROW_DEG) -> int:
    """Return the number of equal steps, one acquisition in the middle of each, that miss no marker.

    Halfway between two of them the curve is still level/peak (12).

    ``level``: largest intensity that noise reaches, positive. ``peak``: intensity with the probe on the marker, in the
    same unit. ``fwhm_deg``: full width at half maximum of its curve. Raises `ValueError` if the peak is not above the
    level: then no number would do.
    """
    if not 0 < level < peak:
        raise ValueError(f"level {level} must be positive and below the peak {peak}; average more pulses")
    far_deg = detection_distance_deg(level=level, peak=peak, fwhm_deg=fwhm_deg)
    return max(1, math.ceil(limits.width_deg / (2 * far_deg)))


def missed_marker(lit: Sequence[Sample], noise: SearchNoise, limits: Interval) -> str:
    """Return which marker a search without a detection may have missed, and what would detect it; empty if none.

    ``lit``: samples with the laser on, at least one.
    """
    level = noise.floor.level
    if level is None or noise.sigma is None or max(sample.reading.intensity for sample in lit) > level:
        return ""
    peak = noise.sigma * 10 ** (WEAKEST_DB / 20)
    if not 0 < level < peak:
        return f"; a marker {WEAKEST_DB:g} dB above the noise would not be detected at all with so few pulses"
    needed = acquisitions_needed(limits, level=level, peak=peak)
    if needed <= len(lit):
        return ""
    return (
        f"; {len(lit)} acquisitions may have missed a marker {WEAKEST_DB:g} dB above the noise and {NARROW_DEG:g} deg "
        f"wide, {needed} would not"
    )
