"""Recipes: the arguments of a rig, stored in a journal to make the same rig again."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.drivers import BenchSettings, bench_settings_from
from markerseek.records.banks import DEFAULT_FORMAT, TableFormat
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
    probe: str | ProbePreset | None
    reference_deg: float | None
    between: Literal["nearest", "interpolated"]
    table: TableFormat = DEFAULT_FORMAT


class BenchRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="bench"):
    """Arguments of `markerseek.rigs.bench_rig.bench`, as the tables of its rig file."""

    # Plain values: the drivers that they name are looked up when they are compared with a rig file.
    tables: dict[str, Any] = msgspec.field(name="settings")

    @classmethod
    def of(cls, settings: BenchSettings) -> BenchRecipe:
        """Recipe with these settings."""
        return cls(tables=settings.table())

    @property
    def settings(self) -> BenchSettings:
        """The settings; `RecordError` if the tables hold none."""
        try:
            return bench_settings_from(self.tables)
        except (ConfigError, RecursionError) as problem:
            raise RecordError(f"the journal's rig cannot be read: {problem}") from problem


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
