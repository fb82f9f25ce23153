"""Absorbers in the patient: position and strength, centroid, and weak ones scattered at random (clutter)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from markerseek.acoustics._checks import not_negative, positive, quantity
from markerseek.acoustics.source import GaussianAbsorber
from markerseek.core import ConfigError, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Absorber:
    """A photoacoustic source at a position in the TRUS frame."""

    radius_m: float
    """Distance ρ from the probe's axis of rotation."""
    angle_deg: float = 0.0
    """Angle θp about that axis."""
    lateral_m: float = 0.0
    """Position y along that axis, from the middle of the array."""
    strength: float = 1.0
    """Peak of the envelope at a point receiver at `REFERENCE_RANGE_M` without attenuation, in the unit of the channel
    data; negative inverts the pulse, 0 gives none."""
    source: GaussianAbsorber = field(default_factory=GaussianAbsorber)

    def __post_init__(self) -> None:
        positive(self.radius_m, name="absorber: radius_m", unit="m", cure="35 to 70 mm from the axis are usual")
        for name, value, unit in (
            ("angle_deg", self.angle_deg, "deg"),
            ("lateral_m", self.lateral_m, "m"),
            ("strength", self.strength, ""),
        ):
            if not math.isfinite(value):
                raise ConfigError(f"absorber: {name} is {quantity(value, unit)}, it must be a finite number")

    @classmethod
    def at(cls, *, x_m: float, y_m: float, z_m: float, strength: float, source: GaussianAbsorber) -> Absorber:
        """Absorber at a point of the TRUS frame (x across, y along the axis of rotation, z out of the probe at 0°)."""
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
    """Centroid of the absorbed energy: its x, y and z in the TRUS frame, in metres.

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Clutter:
    """Weak absorbers at random places of a sector around the probe: blood vessels, pigment, scattered light."""

    count: int
    strength: float = 0.02
    """Mean of their strengths, which are drawn from an exponential distribution, with either sign as likely."""
    nearest_m: float = 20e-3
    farthest_m: float = 70e-3
    """``nearest_m`` and ``farthest_m``: least and largest distance from the axis of rotation."""
    angles: Interval = field(default_factory=lambda: Interval(low_deg=-60.0, high_deg=60.0))
    half_length_m: float = 30e-3
    """Largest distance from the middle of the array along the axis."""

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ConfigError(f"clutter: count is {self.count}, it must not be negative; 0 is no clutter")
        not_negative(self.strength, name="clutter: strength", cure="some per cent of the marker's are usual")
        positive(self.half_length_m, name="clutter: half_length_m", unit="m", cure="30 mm covers the array")
        if not 0 < self.nearest_m < self.farthest_m < math.inf:
            raise ConfigError(
                f"clutter: nearest_m {self.nearest_m} m and farthest_m {self.farthest_m} m "
                "must be positive, finite and rise in this order"
            )

    def draw(self, rng: np.random.Generator) -> tuple[Absorber, ...]:
        """Absorbers at places that are equally likely in every part of the volume."""
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
