"""Sources of sound: the light, what absorbs it and where; their centroid, and weak ones at random (clutter).

A short light pulse leaves an initial pressure p0(x). Far from an absorber of linear size much below the distance r,
the pressure is (1/r)·q(s), s = c·t − r, with q(s) = (1/4π)·dA(s)/ds, where A(s) is the integral of p0 over the plane at
distance s from the absorber's centre, perpendicular to the direction of the receiver (G. J. Diebold, T. Sun and M. I.
Khan, Phys. Rev. Lett. 67, 3384 (1991); Poisson's formula). For spherical absorbers this holds at every distance outside
of them. `GaussianAbsorber.spectrum` is the transform of q over time, Q(f) = (i k/4π c)·∫ A(s) exp(−i k s) ds with
k = 2π f/c, for p0 = 1 at the centre. An absorber that is not small against the distance is several small ones.

The pulse of an absorber is convolved with that of the laser. The middle of the laser pulse is time zero, so that its
length moves no arrival. A laser whose trigger marks the first light has half of its pulse's length in the trigger
offset. The energy is 1: the strength of a source is the caller's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Protocol, TypeAlias, runtime_checkable

import msgspec
import numpy as np

from markerseek.core import Complex128, ConfigError, Float64, Interval, Within, require_fields

Frequencies: TypeAlias = Float64[np.ndarray, " frequencies"]
"""Frequencies in Hz, not negative."""

Spectrum: TypeAlias = Complex128[np.ndarray, " frequencies"]
"""Transform of a pulse over time, of the sign convention exp(−i 2π f t)."""


class GaussianAbsorber(msgspec.Struct, frozen=True, kw_only=True):
    """Soft ball, p0 = exp(−x²/a²); its pulse is q(s) = −(s/2)·exp(−s²/a²)."""

    radius_m: Annotated[float, Within(0, 1, "m", open_low=True, cure="0.05 to 0.4 mm are usual")] = 0.15e-3
    """Radius a at which the absorption has fallen to 1/e."""

    def __post_init__(self) -> None:
        require_fields(self, "Gaussian absorber")

    def spectrum(self, frequency_hz: Frequencies, *, sound_speed_m_s: float) -> Spectrum:
        """Return the transform of r times the pressure, (i k a³√π/4c)·exp(−k²a²/4), in metre seconds."""
        ka = 2 * np.pi * frequency_hz / sound_speed_m_s * self.radius_m
        scale = math.sqrt(math.pi) * self.radius_m**2 / (4 * sound_speed_m_s)
        return 1j * scale * ka * np.exp(-(ka**2) / 4)


@runtime_checkable
class LaserPulse(Protocol):
    """Light in time; two pulses that are equal have equal hashes, because tables are cached by pulse."""

    def __hash__(self) -> int:
        """Hash by value."""

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Return the transform of the pulse over time, 1 at frequency 0."""


class RectanglePulse(msgspec.Struct, frozen=True, kw_only=True):
    """Light that is on for some time, as from a switched diode: it makes a doublet, one pulse at on and one at off."""

    duration_s: Annotated[float, Within(0, 1, "s", open_low=True, cure="5 to 600 ns are usual")] = 500e-9
    """Length."""

    def __post_init__(self) -> None:
        require_fields(self, "rectangle pulse")

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Return the transform sin(π f T)/(π f T)."""
        # `numpy.sinc` has the factor π in it.
        return np.sinc(frequency_hz * self.duration_s).astype(np.complex128)


class GaussianPulse(msgspec.Struct, frozen=True, kw_only=True):
    """Light that swells and fades, as from a Q-switched laser."""

    fwhm_s: Annotated[float, Within(0, 1, "s", open_low=True, cure="5 to 600 ns are usual")] = 5e-9
    """Full width at half of the largest power."""

    def __post_init__(self) -> None:
        require_fields(self, "Gaussian pulse")

    def spectrum(self, frequency_hz: Frequencies) -> Spectrum:
        """Return the transform exp(−(π f T)²/(4 ln 2))."""
        return np.exp(-((np.pi * frequency_hz * self.fwhm_s) ** 2) / (4 * math.log(2))).astype(np.complex128)


class Absorber(msgspec.Struct, frozen=True, kw_only=True):
    """A photoacoustic source at a position in the TRUS frame."""

    radius_m: Annotated[float, Within(0, 1, "m", open_low=True, cure="35 to 70 mm from the axis are usual")]
    """Distance ρ from the probe's axis of rotation."""
    angle_deg: Annotated[float, Within(-360, 360, "deg")] = 0.0
    """Angle θp about that axis."""
    lateral_m: Annotated[float, Within(-1, 1, "m")] = 0.0
    """Position y along that axis, from the middle of the array."""
    strength: Annotated[float, Within(-1e12, 1e12)] = 1.0
    """Peak of the envelope at a point receiver at `REFERENCE_RANGE_M` without attenuation, in the unit of the channel
    data; negative inverts the pulse, 0 gives none."""
    source: GaussianAbsorber = GaussianAbsorber()

    def __post_init__(self) -> None:
        require_fields(self, "absorber")

    @classmethod
    def at(cls, *, x_m: float, y_m: float, z_m: float, strength: float, source: GaussianAbsorber) -> Absorber:
        """Return the absorber at a point of the TRUS frame: x across, y along the axis, z out of the probe at 0°."""
        return cls(
            radius_m=math.hypot(x_m, z_m),
            angle_deg=math.degrees(math.atan2(x_m, z_m)),
            lateral_m=y_m,
            strength=strength,
            source=source,
        )

    @property
    def position_m(self) -> tuple[float, float, float]:
        """Its x, y and z in the TRUS frame, in metres."""
        turned = math.radians(self.angle_deg)
        return self.radius_m * math.sin(turned), self.lateral_m, self.radius_m * math.cos(turned)


def centroid_m(absorbers: Sequence[Absorber]) -> tuple[float, float, float]:
    """Return the centroid of the absorbed energy: its x, y and z in the TRUS frame, in metres.

    The angle of this point is the angle of a marker that is no point. It is not the mean of the absorbers' angles.

    ``absorbers``: those of the marker, all of one kind, so that the energy that each absorbs is proportional to its
    strength.
    """
    energy = math.fsum(each.strength for each in absorbers)
    if not energy > 0 or not all(each.strength >= 0 for each in absorbers):
        raise ConfigError("centroid: the strengths of the absorbers must be positive, one at least; leave clutter out")
    x_m, y_m, z_m = (
        math.fsum(each.strength * each.position_m[axis] for each in absorbers) / energy for axis in range(3)
    )
    return x_m, y_m, z_m


class Clutter(msgspec.Struct, frozen=True, kw_only=True):
    """Weak absorbers at random places of a sector around the probe: blood vessels, pigment, scattered light."""

    count: Annotated[int, Within(0, 1e6, cure="0 is no clutter")]
    strength: Annotated[float, Within(0, 1e12, cure="some per cent of the marker's are usual")] = 0.02
    """Mean of their strengths, which are drawn from an exponential distribution, with either sign as likely."""
    nearest_m: float = 20e-3
    farthest_m: float = 70e-3
    """``nearest_m`` and ``farthest_m``: least and largest distance from the axis of rotation."""
    angles: Interval = Interval(low_deg=-60.0, high_deg=60.0)
    half_length_m: Annotated[float, Within(0, 1, "m", open_low=True, cure="30 mm covers the array")] = 30e-3
    """Largest distance from the middle of the array along the axis."""

    def __post_init__(self) -> None:
        require_fields(self, "clutter")
        if not 0 < self.nearest_m < self.farthest_m < math.inf:
            raise ConfigError(
                f"clutter: nearest_m {self.nearest_m} m and farthest_m {self.farthest_m} m "
                "must be positive, finite and rise in this order"
            )

    def draw(self, rng: np.random.Generator) -> tuple[Absorber, ...]:
        """Return the absorbers at places that are equally likely in every part of the volume."""
        # equal volumes lie between equal steps of ρ²
        radius_m = np.sqrt(rng.uniform(self.nearest_m**2, self.farthest_m**2, self.count))
        angle_deg = rng.uniform(self.angles.low_deg, self.angles.high_deg, self.count)
        lateral_m = rng.uniform(-self.half_length_m, self.half_length_m, self.count)
        strength = rng.exponential(self.strength, self.count) * rng.choice((-1.0, 1.0), self.count)
        places = zip(radius_m.tolist(), angle_deg.tolist(), lateral_m.tolist(), strength.tolist(), strict=True)
        return tuple(
            Absorber(radius_m=radius, angle_deg=angle, lateral_m=lateral, strength=each)
            for radius, angle, lateral, each in places
        )
