from .bench_part import BenchPart, bench_part
from .bench_rig import bench
from .probe_file import chosen_probe, completed_by, preset_of, probe_settings, read_probe_file
from .recipe import BenchRecipe, ReaderRecipe, Recipe, ReplayedRecipe, SimulatedRecipe, SpareRecipe, TipRecipe
from .replay import replayed
from .rig import Rig, fingerprint
from .rig_file import read_rig_file
from .scene import Scene, draw_scene, image_peak, image_reader, scaled_spot, scene_curve, scene_of
from .simulation import USUAL_CELLS, in_world, of_intensities, simulated

__all__ = [
    "USUAL_CELLS",
    "BenchPart",
    "BenchRecipe",
    "ReaderRecipe",
    "Recipe",
    "ReplayedRecipe",
    "Rig",
    "Scene",
    "SimulatedRecipe",
    "SpareRecipe",
    "TipRecipe",
    "bench",
    "bench_part",
    "chosen_probe",
    "completed_by",
    "draw_scene",
    "fingerprint",
    "image_peak",
    "image_reader",
    "in_world",
    "of_intensities",
    "preset_of",
    "probe_settings",
    "read_probe_file",
    "read_rig_file",
    "replayed",
    "scaled_spot",
    "scene_curve",
    "scene_of",
    "simulated",
]
