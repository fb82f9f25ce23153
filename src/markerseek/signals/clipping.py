"""Whether a converter has clipped."""

from __future__ import annotations

import numpy as np

from markerseek.core import Bool, Int32

_REPEATED = 3
"""Samples of a record at its largest number that show a limit: three agree by chance in a few counts' height only."""


def clipped(
    magnitude: Int32[np.ndarray, "channels samples"], *, full_scale: int, recorded: bool
) -> Bool[np.ndarray, " channels"]:
    """Which of some records, given as magnitudes, have touched full scale.

    ``recorded``: they may be of another converter than that of ``full_scale``. Numbers beyond it show that; they are
    its limit where the largest of them repeats.
    """
    largest = magnitude.max(axis=1, initial=0)
    touching: Bool[np.ndarray, " channels"] = largest >= full_scale
    if recorded:
        # The most negative number of a converter is one larger.
        repeated = (magnitude == largest[:, None]).sum(axis=1) >= _REPEATED
        touching &= (largest <= full_scale + 1) | repeated
    return touching
