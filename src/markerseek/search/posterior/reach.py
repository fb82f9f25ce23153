"""How many acquisitions it takes to hear a marker at all, wherever it is."""

from __future__ import annotations

import math

from markerseek.core import Interval

FAINT_DB = 20.0
"""Peak SNR of the faintest marker that a search is asked to find, in dB (physics notes: 20 to 60)."""

NARROW_DEG = 3.0
"""Full width at half maximum of the narrowest usual curve, in degrees (physics notes: 3 to 17)."""

_TAIL, _KNEE = 1.2, 2.4


def acquisitions_needed(limits: Interval, *, level: float, peak: float, fwhm_deg: float = NARROW_DEG) -> int:
    """Return the number of even steps, one acquisition in the middle of each, that leave no marker unheard.

    Halfway between two of them S(t), the commonest member of the family of `shapes`, is still level/peak.

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
    ratio = _KNEE / _TAIL
    far_deg: float = fwhm_deg / 2 * (((peak / level) ** ratio - 1) / (2**ratio - 1)) ** (1 / _KNEE)
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
