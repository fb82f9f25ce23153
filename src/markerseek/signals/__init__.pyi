from .features import LEAST_CHANNELS
from .findings import Arrival, FrameFindings
from .intensities import IntensityReader
from .noise_gain import beamformed_sigma, envelope_cells
from .peaks import strongest_peaks
from .picks import common_wave
from .presets import PRESET_NAMES, ProbePreset, probe_preset
from .reader import ImageReader
from .spare import AnyImageReader, SpareReader

__all__ = [
    "LEAST_CHANNELS",
    "PRESET_NAMES",
    "AnyImageReader",
    "Arrival",
    "FrameFindings",
    "ImageReader",
    "IntensityReader",
    "ProbePreset",
    "SpareReader",
    "beamformed_sigma",
    "common_wave",
    "envelope_cells",
    "probe_preset",
    "strongest_peaks",
]
