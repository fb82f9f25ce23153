"""The forward model, from absorbers and an angle to channel data: source, medium, probe, band, noise. Pure."""

from markerseek.acoustics.absorber import Absorber, Clutter, centroid_m
from markerseek.acoustics.band import Band
from markerseek.acoustics.digitise import LARGEST_COUNT, digitise
from markerseek.acoustics.echoes import Reverberation
from markerseek.acoustics.forward import AcousticModel
from markerseek.acoustics.laser import GaussianPulse, LaserPulse, RectanglePulse
from markerseek.acoustics.medium import Medium
from markerseek.acoustics.noise import Bursts, Noise
from markerseek.acoustics.probe import Probe
from markerseek.acoustics.pulse_echo import two_way_elevation
from markerseek.acoustics.source import GaussianAbsorber

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
