"""Receive band of an element and its receiver."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """Receive band with one peak and a Gaussian skirt on each side, of zero phase.

    Zero phase means that the band moves no arrival: the received pulse is centred on the moment at which the sound
    reaches the element. A real receiver delays by a constant, which is part of the trigger offset.
    The peak need not lie midway between the two ends (the defaults are those of a 5–9 MHz probe centred on 6.5 MHz).
    Each skirt has its own width, with a smooth transition, so that the pulse has no long tails.
    """

    centre_hz: float = 6.5e6
    """Frequency of the largest gain, which is 1."""
    low_hz: float = 5e6
    high_hz: float = 9e6
    """``low_hz`` and ``high_hz``: frequencies below and above it at which the gain is one half (−6 dB); neither side
    may be more than four times as wide as the other."""

    def __post_init__(self) -> None:
        if not 0 < self.low_hz < self.centre_hz < self.high_hz < math.inf:
            raise ConfigError(
                f"band: low_hz {self.low_hz} Hz, centre_hz {self.centre_hz} Hz, high_hz {self.high_hz} Hz: "
                "they must be positive, finite and rise in this order"
            )
        # Far out on its narrow side the width w is less than at −6 dB; at a skew of 8 it would reach 0.
        skew = (self.high_hz - self.centre_hz) / (self.centre_hz - self.low_hz)
        if not 1 / 4 <= skew <= 4:
            raise ConfigError(
                f"band: centre_hz is {self.centre_hz} Hz, one side of the band is {max(skew, 1 / skew):.3g} times as "
                "wide as the other, at most 4 is allowed; move the centre towards the middle"
            )

    def gain(self, frequency_hz: Float64[np.ndarray, " frequencies"]) -> Float64[np.ndarray, " frequencies"]:
        """Gain at each frequency, 1 at the peak: 2^−(x/w)², x = f − centre, with w = a + b·tanh(x/narrower half).

        The numbers a and b are such that w is the half width of the band at either end.

        ``frequency_hz``: frequencies, not negative.
        """
        below, above = self.centre_hz - self.low_hz, self.high_hz - self.centre_hz
        narrower = min(below, above)
        rise = (above - below) / (math.tanh(above / narrower) + math.tanh(below / narrower))
        middle = below + rise * math.tanh(below / narrower)
        away = frequency_hz - self.centre_hz
        half_width = middle + rise * np.tanh(away / narrower)
        gain: Float64[np.ndarray, " frequencies"] = np.exp2(-((away / half_width) ** 2))
        return gain
