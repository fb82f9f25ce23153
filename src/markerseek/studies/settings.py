"""Settings of a study's worlds: intensity curves, the settings that are varied, and all settings of a cell."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from markerseek.core import ConfigError
from markerseek.sim import PowerCurve, SimulatedSettings
from markerseek.studies.scene import SceneSettings

Value: TypeAlias = str | float | int | bool | None
"""A setting that can be varied."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSettings:
    """Source of the intensities at the level "curves"; at the other levels they come from the acoustics."""

    family: Literal["acoustic", "gaussian", "sech", "power"] = "acoustic"
    """The acoustics of the rig, or a closed form (`markerseek.sim.curves`)."""
    fwhm_deg: float = 10.0
    power: float = 1.0
    """``fwhm_deg`` and ``power``: full width at half maximum in degrees and exponent of the tails, for the closed
    forms."""
    draws: int = 4
    """Number of spots of a tissue that are drawn, each with its curve; a trial takes one of them."""
    noise_stated: bool = True
    """Whether each intensity comes with its noise and cells, after dark frames; otherwise it is as in a CSV."""

    def __post_init__(self) -> None:
        # The closed forms know their own bounds.
        PowerCurve(fwhm_deg=self.fwhm_deg, power=self.power)
        if not 1 <= self.draws <= 1000:
            raise ConfigError(f"curve: draws is {self.draws}, it must lie between 1 and 1000")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A setting that takes several values."""

    key: str
    """Its dotted name, as in ``rig.noise.peak_snr_db`` or ``curve.fwhm_deg``."""
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ConfigError(f"vary: {self.key} has no values; give at least one, or leave it out")
        if len(set(self.values)) < len(self.values):
            raise ConfigError(f"vary: {self.key} names a value twice: {list(self.values)}; the cells would be the same")


@dataclass(frozen=True, slots=True, kw_only=True)
class CellWorld:
    """All settings of one cell."""

    curve: CurveSettings
    rig: SimulatedSettings
    scene: SceneSettings = field(default_factory=SceneSettings)
