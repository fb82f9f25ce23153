"""The analogue-to-digital converter of 12 bits: rounds to whole counts and saturates at full scale."""

from __future__ import annotations

import numpy as np

from markerseek.core import ConfigError, Float32, Int16

MIN_COUNT, LARGEST_COUNT = -2048, 2047
"""Full scale of 12 bits, sign included."""


def digitise(data: Float32[np.ndarray, "channels samples"]) -> Int16[np.ndarray, "channels samples"]:
    """Counts, shape (channels, samples): rounded to the nearest (ties to even), held at full scale.

    ``data``: channel data in counts; infinite values saturate.
    """
    if np.isnan(data).any():
        raise ConfigError("digitiser: data holds NaN, for which a converter has no code; correct its source")
    counts: Float32[np.ndarray, "channels samples"] = np.rint(data)
    # Clipped before the conversion to int16, which would wrap an overflow round to the other sign.
    np.clip(counts, MIN_COUNT, LARGEST_COUNT, out=counts)
    return counts.astype(np.int16)
