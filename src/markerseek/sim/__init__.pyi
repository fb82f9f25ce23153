from .bmode import BModeSettings, BModeWorld
from .curves import (
    CurveWorld,
    GaussianCurve,
    IntensityCurve,
    PowerCurve,
    RecordedCurve,
    SechCurve,
    TwoPeaks,
)
from .laser import CLOCK_DRIFT, SimulatedLaser, vary_last_flash
from .motion import TissueMotion, displaced
from .receiver import SimulatedReceiver
from .settings import (
    STREAMING,
    LaserSettings,
    MarkerSettings,
    NoiseSettings,
    ReceiverSettings,
    SimulatedSettings,
    hashable_values,
    with_options,
)
from .stage import HandMotion, SimulatedHand, SimulatedStage, StageMotion, phases
from .stereo_endoscope import (
    EndoscopeSettings,
    SimulatedEndoscope,
    camera_above,
    endoscope,
    on_tissue_m,
)
from .textured_tissue import TexturedTissue
from .tissues import TISSUES, StainedSpot, Tissue, tissue_named
from .world import Flash, SimulatedWorld, VirtualClock, World

__all__ = [
    "CLOCK_DRIFT",
    "STREAMING",
    "TISSUES",
    "BModeSettings",
    "BModeWorld",
    "CurveWorld",
    "EndoscopeSettings",
    "Flash",
    "GaussianCurve",
    "HandMotion",
    "IntensityCurve",
    "LaserSettings",
    "MarkerSettings",
    "NoiseSettings",
    "PowerCurve",
    "ReceiverSettings",
    "RecordedCurve",
    "SechCurve",
    "SimulatedEndoscope",
    "SimulatedHand",
    "SimulatedLaser",
    "SimulatedReceiver",
    "SimulatedSettings",
    "SimulatedStage",
    "SimulatedWorld",
    "StageMotion",
    "StainedSpot",
    "TexturedTissue",
    "Tissue",
    "TissueMotion",
    "TwoPeaks",
    "VirtualClock",
    "World",
    "camera_above",
    "displaced",
    "endoscope",
    "hashable_values",
    "on_tissue_m",
    "phases",
    "tissue_named",
    "vary_last_flash",
    "with_options",
]
