"""Recipes: the arguments from which a rig was made, stored in a journal to make the same rig again."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from markerseek.core import ConfigError
from markerseek.drivers import BenchSettings
from markerseek.records.banks import DEFAULT_FORMAT, TableFormat
from markerseek.signals import ProbePreset
from markerseek.sim import SimulatedSettings


class SimulatedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="simulated"):
    """Arguments of `markerseek.rigs.simulated`."""

    seed: int
    settings: SimulatedSettings
    pace: float

    def __post_init__(self) -> None:
        if not self.seed >= 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or a positive whole number")


class ReplayedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="replayed"):
    """Arguments of `markerseek.rigs.replayed`; the path is absolute."""

    path: str
    probe: str | ProbePreset | None
    reference_deg: float | None
    between: Literal["nearest", "interpolated"]
    table: TableFormat = DEFAULT_FORMAT


class BenchRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="bench"):
    """Arguments of `markerseek.rigs.bench_rig.bench`."""

    settings: BenchSettings


Recipe: TypeAlias = SimulatedRecipe | ReplayedRecipe | BenchRecipe
"""Recipe of any kind of rig."""
