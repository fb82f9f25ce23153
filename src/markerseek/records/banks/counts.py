"""Channel data of other programs as int16 counts: whole numbers exactly, floating-point numbers scaled."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from markerseek.core import Int16, RecordError

SCALED_TO = 2000.0
"""Count of the largest number of scaled data: just below full scale of the presets, 2047."""

EXACT = 1.0
"""Scale of data that are counts already."""

_COUNTS = np.iinfo(np.int16)


def scale_of(path: Path, arrays: Iterable[np.ndarray]) -> float:
    """Counts of one unit, the same for all arrays: `EXACT` if they are whole numbers of int16; warns if they are not.

    ``path``: where they are from, for the messages. ``arrays``: all frames of a recording; each is looked at once.
    """
    exact, largest, kinds = True, 0.0, set()
    for values in arrays:
        if values.dtype.kind not in "iuf":
            raise RecordError(f"{path}: {values.dtype} found, real numbers are expected; convert them")
        if not np.isfinite(values).all():
            raise RecordError(f"{path}: a sample is not finite; replace it, or leave its angle out")
        if values.dtype.newbyteorder("=") == np.int16:
            continue
        kinds.add(str(values.dtype))
        largest = max(largest, float(np.abs(values.astype(np.float64)).max(initial=0.0)))
        within = values.size == 0 or (values.min() >= _COUNTS.min and values.max() <= _COUNTS.max)
        exact = exact and within and bool((values == np.rint(values)).all())
    if exact:
        return EXACT
    scale = SCALED_TO / largest
    warnings.warn(
        f"{path}: {' and '.join(sorted(kinds))} is scaled by {scale:.4g}, its largest number to {SCALED_TO:g} counts; "
        "saturation cannot be told from it",
        stacklevel=3,
    )
    return scale


def as_counts(path: Path, values: np.ndarray, *, scale: float) -> Int16[np.ndarray, " ..."]:
    """The values times the scale as int16, rounded to the nearest."""
    if values.dtype.newbyteorder("=") == np.int16 and scale == EXACT:
        return np.ascontiguousarray(values, dtype=np.int16)
    scaled = values.astype(np.float64) * scale
    counts = np.rint(scaled)
    fits = bool(np.isfinite(counts).all()) and float(np.abs(counts).max(initial=0.0)) <= _COUNTS.max
    if not fits or (scale == EXACT and not np.array_equal(counts, scaled)):
        raise RecordError(f"{path}: {values.dtype} found beside counts of int16; save all frames of a scan alike")
    return counts.astype(np.int16)
