"""Result of the analysis of one frame: its arrivals, and whether there is a source.

`reader.ImageReader` and `spare.SpareReader` return it; `core.Reading` is the short form that a search uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import Arrival


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFindings:
    """Sources in one frame.

    Attributes
    ----------
    found
        Whether any peak passes both tests.
    reason
        Why, or why not, in words.
    strongest
        The strongest arrival; if none was found, the largest peak of the image.
    others
        The other arrivals, strongest first.
    noise_sigma
        Standard deviation of the beamformed signal where there is no source, in ADC counts.
    cells
        Number of independent envelope cells.
    saturated_channels
        Channels that touch full scale while the strongest arrives.
    dead_channels
        Channels without any signal.
    """

    # Separate from `strongest`, which is there also if no peak passes: it says how far from a source the frame is.
    found: bool
    reason: str
    strongest: Arrival
    others: tuple[Arrival, ...]
    noise_sigma: float
    cells: int
    saturated_channels: tuple[int, ...]
    dead_channels: tuple[int, ...]

    def peak_snr_db(self, arrival: Arrival) -> float | None:
        """Intensity of an arrival over the noise floor of the frame in dB; None where there is no noise at all."""
        if not (arrival.intensity > 0 and self.noise_sigma > 0):
            return None
        return 20 * math.log10(arrival.intensity / self.noise_sigma)
