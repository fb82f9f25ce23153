"""The medium between source and probe: speed of sound and attenuation. It is uniform, and it does not disperse."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.acoustics._checks import not_negative
from markerseek.core import Float64, require_range

# Divided by 20 and not by 10, because this is an amplitude.
_NEPER_PER_METRE = math.log(10) / 20 * 100
"""One dB/cm in Np/m."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """Uniform medium.

    Besides the attenuation, the amplitude of a spherical wave falls as 1/r. The attenuation causes no dispersion:
    pulses lose their high frequencies and keep their arrival time (for a power near 1 and soft tissue the true
    dispersion is below 0.1 % of the speed of sound over the band).
    """

    sound_speed_m_s: float = 1540.0
    attenuation_db_cm_mhz: float = 0.1
    """Amplitude attenuation a in dB/(cm MHzⁿ): about 0.1 for gel pads, 0.3 to 0.7 for soft tissue."""
    power: float = 1.0
    """Exponent n of the frequency, 1 to 2."""

    def __post_init__(self) -> None:
        require_range(
            "medium: sound_speed_m_s",
            self.sound_speed_m_s,
            low=300.0,
            high=7000.0,
            unit="m/s",
            cure="water and tissue have 1450 to 1600",
        )
        not_negative(
            self.attenuation_db_cm_mhz,
            name="medium: attenuation_db_cm_mhz",
            unit="dB/cm/MHz",
            cure="soft tissue has about 0.5",
        )
        require_range("medium: power", self.power, low=0.0, high=2.0, cure="soft tissue has about 1, water 2")

    def attenuation_np_m(
        self, frequency_hz: Float64[np.ndarray, " frequencies"]
    ) -> Float64[np.ndarray, " frequencies"]:
        """Attenuation a·fⁿ of the amplitude at each frequency, in Np/m: a wave keeps exp(−a·fⁿ·d) over the path d.

        ``frequency_hz``: frequencies, not negative.
        """
        return _NEPER_PER_METRE * self.attenuation_db_cm_mhz * (frequency_hz / 1e6) ** self.power
