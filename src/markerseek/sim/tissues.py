"""Parameter sets for the paper's five materials, simulated: chosen by us, not measured.

The paper names the materials and not their acoustics. The parameters are those by which they differ for a search: the
size of the spot that absorbs the light (a larger one has a wider and less regular intensity curve), the loss on the
way, weak absorbers around it (clutter) and repeats of the arrival. The path leads through 5 cm of gel pad in all.
"""

from __future__ import annotations

import msgspec
import numpy as np
from msgspec import structs

from markerseek.acoustics import Absorber, Clutter, GaussianAbsorber, Medium, Reverberation, centroid_m
from markerseek.core import ConfigError, Float64


class StainedSpot(msgspec.Struct, frozen=True, kw_only=True):
    """The stained and lit spot that is the marker: small absorbers scattered over a disc, or a single one."""

    count: int = 1
    """Number of absorbers; 1 puts it in the middle."""
    radius_m: float = 0.0
    """Radius of the disc, which lies level (across the z axis of the TRUS frame)."""
    depth_m: float = 0.0
    """Mean depth of the absorbers below the disc, away from the probe; exponentially distributed."""
    grain: GaussianAbsorber = GaussianAbsorber()

    def draw(self, marker: Absorber, rng: np.random.Generator) -> list[Absorber]:
        """Return the absorbers of a spot, whose centroid is the marker's place and whose sum its strength."""
        if self.count == 1:
            return [structs.replace(marker, source=self.grain)]
        # Uniform over the disc: equal areas lie between equal steps of the squared radius.
        away_m = self.radius_m * np.sqrt(rng.uniform(size=self.count))
        around = rng.uniform(0, 2 * np.pi, self.count)
        depth_m = rng.exponential(self.depth_m, self.count)
        middle_m = np.array(marker.position_m)
        places_m = middle_m + np.column_stack([away_m * np.cos(around), away_m * np.sin(around), depth_m])
        # Equal shares: the pulses of the grains interfere, so that the image's peak is less than the sum.
        share = marker.strength / self.count
        # A few grains drawn at random have their centroid beside the middle of the disc, and below its surface.
        drawn = [_grain(position_m, share, self.grain) for position_m in places_m]
        return [_grain(position_m, share, self.grain) for position_m in places_m + (middle_m - centroid_m(drawn))]


def _grain(position_m: Float64[np.ndarray, 3], strength: float, source: GaussianAbsorber) -> Absorber:
    x_m, y_m, z_m = position_m.tolist()
    return Absorber.at(x_m=x_m, y_m=y_m, z_m=z_m, strength=strength, source=source)


class Tissue(msgspec.Struct, frozen=True, kw_only=True):
    """A simulated material."""

    description: str
    """Which material it is, and that it is simulated."""
    spot: StainedSpot = StainedSpot()
    medium: Medium = Medium()
    """Sound speed and attenuation of the path."""
    clutter: Clutter | None = None
    """Weak absorbers around; a strength of 1 is that of the marker; None for none."""
    reverberation: Reverberation | None = None


_FINE = GaussianAbsorber(radius_m=0.08e-3)


def _background(strength: float) -> Clutter:
    """Return the weak absorbers in the slab of tissue, which begins behind the gel pad."""
    return Clutter(count=8, strength=strength, nearest_m=58e-3, farthest_m=75e-3, half_length_m=25e-3)


TISSUES: dict[str, Tissue] = {
    "plastisol-phantom": Tissue(
        description="homogeneous black plastisol phantom (simulated)",
    ),
    "liver": Tissue(
        description="bovine liver with an ink spot (simulated)",
        spot=StainedSpot(count=24, radius_m=0.6e-3, depth_m=0.3e-3, grain=_FINE),
        medium=Medium(attenuation_db_cm_mhz=0.15),
        clutter=_background(0.02),
    ),
    "muscle": Tissue(
        description="bovine muscle with an ink spot (simulated)",
        spot=StainedSpot(count=24, radius_m=0.9e-3, depth_m=0.5e-3, grain=_FINE),
        medium=Medium(attenuation_db_cm_mhz=0.2),
        clutter=_background(0.03),
        reverberation=Reverberation(delay_s=4e-6, gain=0.1, repeats=1),
    ),
    "chicken-breast": Tissue(
        description="chicken breast with an ink spot (simulated)",
        spot=StainedSpot(count=24, radius_m=0.4e-3, depth_m=0.2e-3, grain=_FINE),
        medium=Medium(attenuation_db_cm_mhz=0.12),
        clutter=_background(0.01),
    ),
    "muscle-icg": Tissue(
        description="bovine muscle stained with indocyanine green (simulated)",
        spot=StainedSpot(count=24, radius_m=1.2e-3, depth_m=0.8e-3, grain=_FINE),
        medium=Medium(attenuation_db_cm_mhz=0.2),
        clutter=_background(0.04),
    ),
}


def tissue_named(name: str) -> Tissue:
    """Return the parameter set of a simulated material.

    ``name``: one of `TISSUES`.
    """
    if name not in TISSUES:
        raise ConfigError(f"tissue {name!r} is unknown; the simulated ones are: {', '.join(TISSUES)}")
    return TISSUES[name]
