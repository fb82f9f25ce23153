"""The forward model, from absorbers and an angle to channel data: source, medium, probe, band, noise. Pure."""

from markerseek.acoustics.forward import AcousticModel
from markerseek.acoustics.medium import Medium, Reverberation
from markerseek.acoustics.pulse_echo import two_way_elevation
from markerseek.acoustics.receiver import LARGEST_COUNT, Band, Bursts, Noise, Probe, digitise
from markerseek.acoustics.source import (
    Absorber,
    Clutter,
    GaussianAbsorber,
    GaussianPulse,
    LaserPulse,
    RectanglePulse,
    centroid_m,
)

__all__ = [
    "LARGEST_COUNT",
    "Absorber",
    "AcousticModel",
    "Band",
    "Bursts",
    "Clutter",
    "GaussianAbsorber",
    "GaussianPulse",
    "LaserPulse",
    "Medium",
    "Noise",
    "Probe",
    "RectanglePulse",
    "Reverberation",
    "centroid_m",
    "digitise",
    "two_way_elevation",
]
