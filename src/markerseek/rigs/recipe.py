"""What a journal keeps of a rig, so that it can be made again: the recipe of each kind."""

from __future__ import annotations

from typing import TypeAlias

from markerseek.rigs.bench_rig import BenchRecipe
from markerseek.rigs.replay import ReplayedRecipe
from markerseek.rigs.simulation import SimulatedRecipe

Recipe: TypeAlias = SimulatedRecipe | ReplayedRecipe | BenchRecipe
"""Recipe of any kind of rig."""
