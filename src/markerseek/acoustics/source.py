"""A Gaussian absorber: its far-field photoacoustic pulse in closed form.

A short light pulse leaves an initial pressure p0(x). Far from an absorber of linear size much below the distance r,
the pressure is (1/r)·q(s), s = c·t − r, with q(s) = (1/4π)·dA(s)/ds, where A(s) is the integral of p0 over the plane at
distance s from the absorber's centre, perpendicular to the direction of the receiver (G. J. Diebold, T. Sun and M. I.
Khan, Phys. Rev. Lett. 67, 3384 (1991); Poisson's formula). For spherical absorbers this holds at every distance outside
of them. `GaussianAbsorber.spectrum` is the transform of q over time, Q(f) = (i k/4π c)·∫ A(s) exp(−i k s) ds with
k = 2π f/c, for p0 = 1 at the centre. An absorber that is not small against the distance is several small ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from markerseek.acoustics._checks import positive
from markerseek.core import Complex128, Float64

Frequencies: TypeAlias = Float64[np.ndarray, " frequencies"]
"""Frequencies in Hz, not negative."""

Spectrum: TypeAlias = Complex128[np.ndarray, " frequencies"]
"""Transform of a pulse over time, of the sign convention exp(−i 2π f t)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianAbsorber:
    """Soft ball, p0 = exp(−x²/a²); its pulse is q(s) = −(s/2)·exp(−s²/a²)."""

    radius_m: float = 0.15e-3
    """Radius a at which the absorption has fallen to 1/e."""

    def __post_init__(self) -> None:
        positive(self.radius_m, name="Gaussian absorber: radius_m", unit="m", cure="0.05 to 0.4 mm are usual")

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Transform of r times the pressure, (i k a³√π/4c)·exp(−k²a²/4), in metre seconds."""
        ka = 2 * np.pi * frequency_hz / sound_speed_m_s * self.radius_m
        scale = math.sqrt(math.pi) * self.radius_m**2 / (4 * sound_speed_m_s)
        return 1j * scale * ka * np.exp(-(ka**2) / 4)
