from .findings import FrameFindings
from .intensities import IntensityReader
from .noise_gain import beamformed_sigma, envelope_cells
from .own_probe import ProbeKeys, is_own
from .peaks import strongest_peaks
from .picks import common_wave
from .pickup import pickup_amplitude
from .presets import PRESET_NAMES, ProbePreset, probe_preset
from .reader import ImageReader
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
