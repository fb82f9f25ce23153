"""The paper's five materials as parameter sets: simulated stand-ins, chosen by us and measured on nothing.

The paper names the materials and not their acoustics. What is set here is what tells them apart for a search: the size
of the absorber under the laser (the wider it is, the wider the intensity curve), the loss on the way, weak absorbers
around (clutter) and repeats of the arrival. The path leads through 5 cm of gel pad in all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from markerseek.acoustics import Clutter, Disc, GaussianAbsorber, Medium, Reverberation, Source
from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tissue:
    """A simulated stand-in for a material.

    Attributes
    ----------
    description
        What it stands for, and that it is simulated.
    source
        Size and shape of the marker's absorber.
    medium
        Sound speed and attenuation of the path.
    clutter
        Weak absorbers around; None for none.
    reverberation
        Repeats of every arrival; None for none.
    """

    description: str
    source: Source
    medium: Medium = field(default_factory=Medium)
    clutter: Clutter | None = None
    reverberation: Reverberation | None = None


TISSUES: dict[str, Tissue] = {
    "plastisol-phantom": Tissue(
        description="homogeneous black plastisol phantom (simulated stand-in)",
        source=GaussianAbsorber(radius_m=0.15e-3),
    ),
    "liver": Tissue(
        description="bovine liver with an ink spot (simulated stand-in)",
        source=Disc(radius_m=0.8e-3, thickness_m=0.1e-3),
        medium=Medium(attenuation_db_cm_mhz=0.15),
        clutter=Clutter(count=8, strength=0.02),
    ),
    "muscle": Tissue(
        description="bovine muscle with an ink spot (simulated stand-in)",
        source=Disc(radius_m=0.5e-3, thickness_m=0.1e-3),
        medium=Medium(attenuation_db_cm_mhz=0.2),
        clutter=Clutter(count=8, strength=0.04),
        reverberation=Reverberation(delay_s=4e-6, gain=0.1, repeats=1),
    ),
    "chicken-breast": Tissue(
        description="chicken breast with an ink spot (simulated stand-in)",
        source=Disc(radius_m=0.3e-3, thickness_m=0.1e-3),
        medium=Medium(attenuation_db_cm_mhz=0.12),
        clutter=Clutter(count=8, strength=0.01),
    ),
    "muscle-icg": Tissue(
        description="bovine muscle stained with indocyanine green (simulated stand-in)",
        source=GaussianAbsorber(radius_m=0.4e-3),
        medium=Medium(attenuation_db_cm_mhz=0.2),
        clutter=Clutter(count=8, strength=0.06),
    ),
}


def tissue_named(name: str) -> Tissue:
    """Parameter set of a simulated material.

    Parameters
    ----------
    name
        One of `TISSUES`.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    if name not in TISSUES:
        raise ConfigError(f"tissue {name!r} is unknown; the simulated ones are: {', '.join(TISSUES)}")
    return TISSUES[name]
