"""The imaging chain, from a frame to a reading: filter, one-way delay-and-sum, envelope, features. Pure."""

from markerseek.signals.findings import Arrival, FrameFindings
from markerseek.signals.intensities import IntensityReader
from markerseek.signals.noise_gain import beamformed_sigma, envelope_cells
from markerseek.signals.presets import PRESET_NAMES, ProbePreset, probe_preset
from markerseek.signals.reader import ImageReader

__all__ = [
    "PRESET_NAMES",
    "Arrival",
    "FrameFindings",
    "ImageReader",
    "IntensityReader",
    "ProbePreset",
    "beamformed_sigma",
    "envelope_cells",
    "probe_preset",
]
