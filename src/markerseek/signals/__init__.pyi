from .features import FALSE_FOUND, LEAST_CHANNELS, found_level
from .findings import FrameFindings
from .intensities import IntensityReader
from .noise_gain import beamformed_sigma, envelope_cells
from .peaks import strongest_peaks
from .picks import common_wave
from .presets import PRESET_NAMES, ProbePreset, probe_preset
from .reader import ImageReader

__all__ = [
    "FALSE_FOUND",
    "LEAST_CHANNELS",
    "PRESET_NAMES",
    "FrameFindings",
    "ImageReader",
    "IntensityReader",
    "ProbePreset",
    "beamformed_sigma",
    "common_wave",
    "envelope_cells",
    "found_level",
    "probe_preset",
    "strongest_peaks",
]
