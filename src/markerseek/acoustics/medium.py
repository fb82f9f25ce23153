"""What lies between source and probe: speed of sound and attenuation of a uniform medium, and repeats of an arrival."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np

from markerseek.core import Float64, Within, require_fields

# Divided by 20 and not by 10, because this is an amplitude.
_NEPER_PER_METRE = math.log(10) / 20 * 100
"""One dB/cm in Np/m."""


class Medium(msgspec.Struct, frozen=True, kw_only=True):
    """Uniform medium.

    Besides the attenuation, the amplitude of a spherical wave falls as 1/r. The attenuation causes no dispersion:
    pulses lose their high frequencies and keep their arrival time (for a power near 1 and soft tissue the true
    dispersion is below 0.1 % of the speed of sound over the band).
    """

    sound_speed_m_s: Annotated[float, Within(300, 7000, "m/s", cure="water and tissue have 1450 to 1600")] = 1540.0
    attenuation_db_cm_mhz: Annotated[float, Within(0, 1000, "dB/cm/MHz", cure="soft tissue has about 0.5")] = 0.1
    """Amplitude attenuation a in dB/(cm MHzⁿ): about 0.1 for gel pads, 0.3 to 0.7 for soft tissue."""
    power: Annotated[float, Within(0, 2, cure="soft tissue has about 1, water 2")] = 1.0
    """Exponent n of the frequency, 1 to 2."""

    def __post_init__(self) -> None:
        require_fields(self, "medium")

    def attenuation_np_m(
        self, frequency_hz: Float64[np.ndarray, " frequencies"]
    ) -> Float64[np.ndarray, " frequencies"]:
        """Return the attenuation a·fⁿ at each frequency, in Np/m: a wave keeps exp(−a·fⁿ·d) of its amplitude.

        ``frequency_hz``: frequencies, not negative.
        """
        return _NEPER_PER_METRE * self.attenuation_db_cm_mhz * (frequency_hz / 1e6) ** self.power


class Reverberation(msgspec.Struct, frozen=True, kw_only=True):
    """Repeats of every arrival, as between the probe's face and a layer in front of it."""

    delay_s: Annotated[float, Within(0, 1, "s", open_low=True, cure="1 to 20 µs are usual")]
    """Time from one repeat to the next: twice the layer's thickness over the speed of sound."""
    gain: Annotated[float, Within(-1, 1, cure="0.05 to 0.3 are usual")] = 0.1
    """Amplitude of a repeat over that of the one before it, −1 to 1; negative turns each over."""
    repeats: Annotated[int, Within(1, 100, cure="leave the reverberation out for none")] = 2

    def __post_init__(self) -> None:
        require_fields(self, "reverberation")
