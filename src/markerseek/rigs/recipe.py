"""Recipes: the arguments from which a rig was made, stored in a journal to make the same rig again."""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from markerseek.core import ConfigError
from markerseek.drivers import BenchSettings
from markerseek.signals import ProbePreset
from markerseek.sim import SimulatedSettings
from markerseek.vision import TipSettings


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
    probe: str | None
    reference_deg: float | None
    between: Literal["nearest", "interpolated"]


class BenchRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="bench"):
    """Arguments of `markerseek.rigs.bench_rig.bench`."""

    settings: BenchSettings


Recipe: TypeAlias = SimulatedRecipe | ReplayedRecipe | BenchRecipe
"""Recipe of any kind of rig."""


class SpareRecipe(msgspec.Struct, frozen=True, kw_only=True, tag_field="reader", tag="spare"):
    """Arguments of `markerseek.signals.SpareReader`."""

    preset: ProbePreset
    receive_focus_m: float | None


class TipRecipe(msgspec.Struct, frozen=True, kw_only=True, tag_field="reader", tag="tooltip"):
    """Arguments of `markerseek.vision.TipReader`."""

    settings: TipSettings


ReaderRecipe: TypeAlias = ProbePreset | SpareRecipe | TipRecipe | None
"""What a journal holds of a rig's reader; a preset stands for channel data, None for intensities."""
