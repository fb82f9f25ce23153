"""From how far a marker is heard: how many acquisitions it takes to hear any, and where a louder one may still hide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from markerseek.core import Interval

FAINT_DB = 20.0
"""Peak SNR of the faintest marker that a search is asked to find, in dB (physics notes: 20 to 60)."""

NARROW_DEG = 3.0
"""Full width at half maximum of the narrowest usual curve, in degrees (physics notes: 3 to 17)."""

LOUDER = 5.0
"""What was heard is taken for clutter of a marker this many times as loud, if that one could have gone unheard."""

_TAIL, _KNEE = 1.2, 2.4


def reach_deg(*, level: float, peak: float, fwhm_deg: float) -> float:
    """Return the distance at which S(t), the commonest member of the family of `shapes`, is level/peak, in degrees.

    Parameters
    ----------
    level, peak
        Intensity that noise does not reach, and that with the probe on the marker; 0 < level < peak.
    fwhm_deg
        Full width at half maximum of the curve, in degrees.
    """
    ratio = _KNEE / _TAIL
    scaled = ((peak / level) ** ratio - 1) / (2**ratio - 1)
    return fwhm_deg / 2 * math.pow(scaled, 1 / _KNEE)


def hiding_deg(
    heard_deg: Sequence[float], limits: Interval, *, level: float, peak: float, fwhm_deg: float
) -> float | None:
    """Return the angle farthest from all heard ones, if a marker `LOUDER` than the peak would be unheard there.

    Parameters
    ----------
    heard_deg
        Angles heard so far, in degrees.
    limits
        Range of the search.
    level
        Intensity that noise does not reach.
    peak, fwhm_deg
        Height of the curve that was found, and its full width at half maximum in degrees.
    """
    inside = sorted(min(max(angle_deg, limits.low_deg), limits.high_deg) for angle_deg in heard_deg)
    gaps = [((high - low) / 2, (low + high) / 2) for low, high in pairwise(inside)]
    gaps += [(inside[0] - limits.low_deg, limits.low_deg), (limits.high_deg - inside[-1], limits.high_deg)]
    far_deg, where_deg = max(gaps)
    louder = LOUDER * peak
    heard = louder > level > 0 and far_deg <= reach_deg(level=level, peak=louder, fwhm_deg=fwhm_deg)
    return None if heard else where_deg


def acquisitions_needed(limits: Interval, *, level: float, peak: float, fwhm_deg: float = NARROW_DEG) -> int:
    """Return the number of even steps, one acquisition in the middle of each, that leave no marker unheard.

    Halfway between two of them the curve is still level/peak (`reach_deg`).

    Parameters
    ----------
    limits
        Range of the search.
    level
        Intensity that noise does not reach, positive.
    peak
        Intensity with the probe on the marker, in the same unit.
    fwhm_deg
        Full width at half maximum of its curve, in degrees.

    Raises
    ------
    ValueError
        If the peak is not above the level: then no number would do.
    """
    if not 0 < level < peak:
        raise ValueError(f"level {level} must be positive and below the peak {peak}; average more pulses")
    far_deg = reach_deg(level=level, peak=peak, fwhm_deg=fwhm_deg)
    return max(1, math.ceil(limits.width_deg / (2 * far_deg)))


def unheard(limits: Interval, *, made: int, level: float, sigma: float) -> str:
    """Return what a search that heard nothing may have missed, and what would do, in words; empty if nothing.

    Parameters
    ----------
    limits
        Range of the search.
    made
        Acquisitions made.
    level, sigma
        Intensity that noise does not reach, and standard deviation of one quadrature of the noise.
    """
    peak = sigma * 10 ** (FAINT_DB / 20)
    if not 0 < level < peak:
        return f"; a marker {FAINT_DB:g} dB above the noise would not be heard at all: average more pulses"
    needed = acquisitions_needed(limits, level=level, peak=peak)
    if needed <= made:
        return ""
    return (
        f"; {made} acquisitions may have missed a marker {FAINT_DB:g} dB above the noise and {NARROW_DEG:g} deg wide, "
        f"{needed} would not"
    )
