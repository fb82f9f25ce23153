"""Simulated rigs: virtual time, tissue, stage, laser and receiver. All that they produce is marked as simulated.

It uses `acoustics` and never `signals`: the forward model and the imaging share no code.
"""

from markerseek.sim.bmode import BModeSettings, BModeWorld
from markerseek.sim.curves import (
    CurveWorld,
    GaussianCurve,
    IntensityCurve,
    PowerCurve,
    RecordedCurve,
    SechCurve,
    TwoPeaks,
)
from markerseek.sim.laser import CLOCK_DRIFT, SimulatedLaser, vary_last_flash
from markerseek.sim.motion import TissueMotion, displaced
from markerseek.sim.receiver import SimulatedReceiver
from markerseek.sim.settings import (
    STREAMING,
    LaserSettings,
    MarkerSettings,
    NoiseSettings,
    ReceiverSettings,
    SimulatedSettings,
    hashable_values,
    with_options,
)
from markerseek.sim.stage import HandMotion, SimulatedHand, SimulatedStage, StageMotion, phases
from markerseek.sim.stereo_endoscope import (
    EndoscopeSettings,
    SimulatedEndoscope,
    camera_above,
    endoscope,
    on_tissue_m,
)
from markerseek.sim.textured_tissue import TexturedTissue
from markerseek.sim.tissues import TISSUES, StainedSpot, Tissue, tissue_named
from markerseek.sim.world import Flash, SimulatedWorld, VirtualClock, World

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
