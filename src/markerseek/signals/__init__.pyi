from .noise_gain import beamformed_sigma, envelope_cells
from .peaks import strongest_peaks
from .picks import common_wave
from .pickup import pickup_amplitude
from .presets import PRESET_NAMES, ProbeKeys, ProbePreset, is_own, probe_preset
from .reader import FrameFindings, ImageReader, IntensityReader
from .spare import SpareReader

__all__ = [
    "PRESET_NAMES",
    "FrameFindings",
    "ImageReader",
    "IntensityReader",
    "ProbeKeys",
    "ProbePreset",
    "SpareReader",
    "beamformed_sigma",
    "common_wave",
    "envelope_cells",
    "is_own",
    "pickup_amplitude",
    "probe_preset",
    "strongest_peaks",
]
