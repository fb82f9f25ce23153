"""What absorbs the light: far-field photoacoustic pulses in closed form.

Light that comes at once leaves a pressure p0(x) behind. Far from an absorber of linear size much below the distance r,
the pressure is (1/r)·q(s), s = c·t − r, with q(s) = (1/4π)·dA(s)/ds, where A(s) is the integral of p0 over the plane at
distance s from the absorber's middle, perpendicular to the direction of hearing (G. J. Diebold, T. Sun and M. I. Khan,
Phys. Rev. Lett. 67, 3384 (1991); Poisson's formula). For absorbers that are the same from all sides this holds at every
distance outside of them. Each class gives the transform of q over time, Q(f) = (i k/4π c)·∫ A(s) exp(−i k s) ds with
k = 2π f/c, for p0 = 1 in the middle. An absorber that is not small against the distance is a cloud of small ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from scipy.special import j1, spherical_jn

from markerseek.acoustics._checks import positive, within
from markerseek.core.shapes import Complex128, Float64

Frequencies: TypeAlias = Float64[np.ndarray, " frequencies"]
"""Frequencies in Hz, not negative."""

Spectrum: TypeAlias = Complex128[np.ndarray, " frequencies"]
"""Transform of a pulse over time, of the sign convention exp(−i 2π f t)."""


class Source(Protocol):
    """Small absorber that can tell its pulse; two that are equal have equal hashes, as tables are kept by source."""

    def __hash__(self) -> int:
        """Hash by value."""

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Transform Q(f) of r times the far-field pressure, in metre seconds, at frequencies in Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianAbsorber:
    """Soft ball, p0 = exp(−x²/a²); its pulse is q(s) = −(s/2)·exp(−s²/a²).

    Attributes
    ----------
    radius_m
        Radius a at which the absorption has fallen to 1/e, in metres.
    """

    radius_m: float = 0.15e-3

    def __post_init__(self) -> None:
        positive(self.radius_m, name="Gaussian absorber: radius_m", unit="m", cure="0.05 to 0.4 mm are usual")

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Transform of r times the pressure, (i k a³√π/4c)·exp(−k²a²/4), in metre seconds.

        Parameters
        ----------
        frequency_hz
            Frequencies in Hz.
        sound_speed_m_s
            Speed of sound c in m/s.
        """
        ka = 2 * np.pi * frequency_hz / sound_speed_m_s * self.radius_m
        scale = math.sqrt(math.pi) * self.radius_m**2 / (4 * sound_speed_m_s)
        return 1j * scale * ka * np.exp(-(ka**2) / 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere:
    """Ball with a sharp edge, p0 = 1 inside; its pulse is the N wave q(s) = −s/2 for |s| < a.

    Attributes
    ----------
    radius_m
        Radius a in metres.
    """

    radius_m: float = 0.15e-3

    def __post_init__(self) -> None:
        positive(self.radius_m, name="sphere: radius_m", unit="m", cure="0.05 to 0.4 mm are usual")

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Transform of r times the pressure, (i a²/c)·j₁(k a), in metre seconds.

        Parameters
        ----------
        frequency_hz
            Frequencies in Hz.
        sound_speed_m_s
            Speed of sound c in m/s.
        """
        ka = 2 * np.pi * frequency_hz / sound_speed_m_s * self.radius_m
        return 1j * self.radius_m**2 / sound_speed_m_s * spherical_jn(1, ka).astype(np.complex128)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disc:
    """Flat round patch, p0 = exp(−x²/d²) through its thickness and 1 across it, heard at one tilt.

    Tilt is the angle between the disc's normal and the direction of hearing; the whole array is taken to hear the disc
    at the same tilt, so a disc whose radius is not small against the distance belongs into a cloud of small absorbers.

    Attributes
    ----------
    radius_m
        Radius a in metres.
    thickness_m
        Half thickness d at which the absorption has fallen to 1/e, in metres.
    tilt_deg
        Tilt α in degrees, 0 (face on) to 90.
    """

    radius_m: float = 0.5e-3
    thickness_m: float = 0.05e-3
    tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        positive(self.radius_m, name="disc: radius_m", unit="m", cure="0.05 to 0.5 mm are usual")
        positive(self.thickness_m, name="disc: thickness_m", unit="m", cure="stains are 0.02 to 0.2 mm deep")
        within(self.tilt_deg, low=0.0, high=90.0, name="disc: tilt_deg", unit="deg", cure="0 is face on")

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Transform of r times the pressure, (i k a² d√π/4c)·[2J₁(u)/u]·exp(−(k d cos α)²/4), u = k a sin α.

        The product of the transforms of a disc and of a Gaussian layer; in metre seconds.

        Parameters
        ----------
        frequency_hz
            Frequencies in Hz.
        sound_speed_m_s
            Speed of sound c in m/s.
        """
        k = 2 * np.pi * frequency_hz / sound_speed_m_s
        tilt = math.radians(self.tilt_deg)
        across = k * self.radius_m * math.sin(tilt)
        # 2J₁(u)/u is 1 at u = 0
        edge = np.divide(2 * j1(across), across, out=np.ones_like(across), where=across > 0)
        layer = np.exp(-((k * self.thickness_m * math.cos(tilt)) ** 2) / 4)
        scale = math.sqrt(math.pi) * self.radius_m**2 * self.thickness_m / (4 * sound_speed_m_s)
        return 1j * scale * k * edge * layer
