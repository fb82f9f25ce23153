"""Result of the analysis of one frame: its arrivals, and whether there is a source.

`reader.ImageReader` and `spare.SpareReader` return it; `core.Reading` is the short form that a search uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import Arrival


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFindings:
    """Sources in one frame."""

    # Separate from `strongest`, which is there also if no peak passes: it says how far from a source the frame is.
    found: bool
    """Whether any peak passes both tests."""
    reason: str
    """Why, or why not, in words."""
    strongest: Arrival
    """The strongest arrival; if none was found, the largest peak of the image."""
    others: tuple[Arrival, ...]
    """The other arrivals, strongest first."""
    noise_sigma: float
    """Standard deviation of the beamformed signal where there is no source, in ADC counts."""
    cells: int
    """Number of independent envelope cells."""
    saturated_channels: tuple[int, ...]
    """Channels that touch full scale while the strongest arrives."""
    dead_channels: tuple[int, ...]
    """Channels without any signal."""

    def peak_snr_db(self, arrival: Arrival) -> float | None:
        """Intensity of an arrival over the noise floor of the frame in dB; None if there is no noise at all."""
        if not (arrival.intensity > 0 and self.noise_sigma > 0):
            return None
        return 20 * math.log10(arrival.intensity / self.noise_sigma)
