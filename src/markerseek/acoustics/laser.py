"""Laser pulses over time; an absorber's pulse is convolved with them.

The middle of the pulse is time zero, so that its length moves no arrival. A laser whose trigger marks the
first light has half of its pulse's length in the trigger offset. The energy is 1: the strength of a source is the
caller's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from markerseek.acoustics._checks import positive
from markerseek.acoustics.source import Frequencies, Spectrum


@runtime_checkable
class LaserPulse(Protocol):
    """Light in time; two pulses that are equal have equal hashes, because tables are cached by pulse."""

    def __hash__(self) -> int:
        """Hash by value."""

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Transform of the pulse over time, 1 at frequency 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RectanglePulse:
    """Light that is on for some time, as from a switched diode: it makes a doublet, one pulse at on and one at off."""

    duration_s: float = 500e-9
    """Length."""

    def __post_init__(self) -> None:
        positive(self.duration_s, name="rectangle pulse: duration_s", unit="s", cure="5 to 600 ns are usual")

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Transform sin(π f T)/(π f T)."""
        # `numpy.sinc` has the factor π in it.
        return np.sinc(frequency_hz * self.duration_s).astype(np.complex128)


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianPulse:
    """Light that swells and fades, as from a Q-switched laser."""

    fwhm_s: float = 5e-9
    """Full width at half of the largest power."""

    def __post_init__(self) -> None:
        positive(self.fwhm_s, name="Gaussian pulse: fwhm_s", unit="s", cure="5 to 600 ns are usual")

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Transform exp(−(π f T)²/(4 ln 2))."""
        return np.exp(-((np.pi * frequency_hz * self.fwhm_s) ** 2) / (4 * math.log(2))).astype(np.complex128)
