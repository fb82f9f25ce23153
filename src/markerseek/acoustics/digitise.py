"""The analogue-to-digital converter: rounds to whole counts and saturates at full scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.acoustics._checks import positive
from markerseek.core import ConfigError, Float32, Int16


@dataclass(frozen=True, slots=True, kw_only=True)
class Digitiser:
    """Analogue-to-digital converter.

    Attributes
    ----------
    bits
        Number of bits, sign included: 12 give counts from −2048 to 2047, kept in 16.
    counts_per_unit
        Counts for one unit of the channel data.
    """

    bits: int = 12
    counts_per_unit: float = 1.0

    def __post_init__(self) -> None:
        if not 2 <= self.bits <= 16:
            raise ConfigError(f"digitiser: bits is {self.bits}, it must lie between 2 and 16; 12 is usual")
        positive(
            self.counts_per_unit, name="digitiser: counts_per_unit", unit="counts", cure="1 takes counts as they come"
        )

    @property
    def least(self) -> int:
        """Smallest count."""
        return -(1 << (self.bits - 1))

    @property
    def largest(self) -> int:
        """Largest count."""
        return (1 << (self.bits - 1)) - 1

    def digitise(self, data: Float32[np.ndarray, "channels samples"]) -> Int16[np.ndarray, "channels samples"]:
        """Counts, shape (channels, samples): rounded to the nearest (ties to even), held at full scale.

        Parameters
        ----------
        data
            Channel data in the unit of ``counts_per_unit``; infinite values saturate.

        Raises
        ------
        ConfigError
            If a value is NaN: a converter has no code for it.
        """
        counts = data * np.float32(self.counts_per_unit)
        if np.isnan(counts).any():
            raise ConfigError("digitiser: data holds NaN, for which a converter has no code; correct its source")
        np.rint(counts, out=counts)
        # Clipped before the conversion to int16, which would wrap an overflow round to the other sign.
        np.clip(counts, self.least, self.largest, out=counts)
        return counts.astype(np.int16)
