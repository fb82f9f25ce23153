"""Grey levels of photoacoustic images, in decibels below the brightest."""

from __future__ import annotations

import numpy as np

from markerseek.core import Float32, UInt8

RANGE_DB = 40.0
"""From the brightest level to black, in dB."""


def grey_levels(
    envelope: Float32[np.ndarray, "rows columns"], *, brightest: float
) -> UInt8[np.ndarray, "rows columns"]:
    """Return shades from 0 (`RANGE_DB` and more below the brightest) to 255 (the brightest and above).

    ``envelope``, ``brightest``: in ADC counts.
    """
    return np.rint(255 * (1 + decibels_below_peak(envelope, peak=brightest) / RANGE_DB)).astype(np.uint8)


def decibels_below_peak(
    envelope: Float32[np.ndarray, "rows columns"], *, peak: float
) -> Float32[np.ndarray, "rows columns"]:
    """Return the level relative to a peak, from ``-RANGE_DB`` to 0 dB; a frame without sound is at ``-RANGE_DB``."""
    # The lower end is clipped before the logarithm, because 0 has no logarithm.
    share = np.clip(envelope / (peak or 1.0), 10 ** (-RANGE_DB / 20), 1.0)
    return 20 * np.log10(share)
