from .bench_rig import bench, bench_part
from .probe_file import blanked_samples, chosen_probe, preset_of, probe_facts, read_recording, with_probe_facts
from .replay import replayed
from .rig import (
    BenchRecipe,
    Recipe,
    ReplayedRecipe,
    Rig,
    SimulatedRecipe,
    fingerprint,
    read_rig_file,
    read_simulated,
)
from .scene import Scene, draw_scene, image_peak, image_reader, largest_count, scene_curve, scene_of
from .simulation import (
    USUAL_CELLS,
    Beside,
    MovableMarker,
    marker_scene,
    movable,
    of_intensities,
    rig_in_world,
    simulated,
)

__all__ = [
    "USUAL_CELLS",
    "BenchRecipe",
    "Beside",
    "MovableMarker",
    "Recipe",
    "ReplayedRecipe",
    "Rig",
    "Scene",
    "SimulatedRecipe",
    "bench",
    "bench_part",
    "blanked_samples",
    "chosen_probe",
    "draw_scene",
    "fingerprint",
    "image_peak",
    "image_reader",
    "largest_count",
    "marker_scene",
    "movable",
    "of_intensities",
    "preset_of",
    "probe_facts",
    "read_recording",
    "read_rig_file",
    "read_simulated",
    "replayed",
    "rig_in_world",
    "scene_curve",
    "scene_of",
    "simulated",
    "with_probe_facts",
]
