from .bench_part import BenchPart, bench_part
from .bench_rig import bench
from .recipe import BenchRecipe, Recipe, ReplayedRecipe, SimulatedRecipe
from .replay import preset_of, replayed
from .rig import Rig, fingerprint
from .rig_file import read_rig_file
from .scene import draw_scene, image_reader, scaled_spot, scene_curve
from .simulation import USUAL_CELLS, in_world, of_intensities, simulated

__all__ = [
    "USUAL_CELLS",
    "BenchPart",
    "BenchRecipe",
    "Recipe",
    "ReplayedRecipe",
    "Rig",
    "SimulatedRecipe",
    "bench",
    "bench_part",
    "draw_scene",
    "fingerprint",
    "image_reader",
    "in_world",
    "of_intensities",
    "preset_of",
    "read_rig_file",
    "replayed",
    "scaled_spot",
    "scene_curve",
    "simulated",
]
