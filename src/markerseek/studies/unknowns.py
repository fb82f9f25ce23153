"""Unknown properties of a rig and its marker, drawn for each trial over the ranges of the physics table.

Policies receive none of them. In addition to the table the attenuation of the medium is drawn, from that of a gel pad
to that of soft tissue. The receiver's settings (sampling, samples, noise) are those of the study.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from markerseek.acoustics import (
    Absorber,
    AcousticModel,
    Band,
    GaussianAbsorber,
    GaussianPulse,
    LaserPulse,
    Medium,
    Probe,
    RectanglePulse,
)
from markerseek.sim import ReceiverSettings, SimulatedSettings

ELEMENT_HEIGHT_M = (3e-3, 6e-3)
"""Element height in metres."""

FOCUS_M = (20e-3, 40e-3)
"""Elevation focus in metres."""

NO_LENS = 0.2
"""Share of probes without a lens."""

FACE_RADIUS_M = (8e-3, 12e-3)
"""Distance of the face from the axis in metres."""

MARKER_RADIUS_M = (35e-3, 70e-3)
"""Distance of the marker from the axis in metres."""

SOURCE_RADIUS_M = (0.05e-3, 0.4e-3)
"""Radius of the Gaussian absorber in metres, evenly spread in its logarithm."""

PULSE_S = (5e-9, 600e-9)
"""Length of the laser pulse in seconds: of a rectangle, or (as often) the full width at half maximum of a Gaussian."""

TRIGGER_OFFSET_S = (-1e-6, 1e-6)
"""Trigger offset in seconds."""

SOUND_SPEED_M_S = (1450.0, 1600.0)
"""Speed of sound in m/s."""

CENTRE_HZ = (4e6, 7e6)
"""Frequency of the band's largest gain in Hz; the band reaches 1.5 MHz below and 2.5 MHz above it, as usual."""

ATTENUATION_DB_CM_MHZ = (0.05, 0.5)
"""Attenuation in dB/(cm MHz)."""

STAMP_DELAY_S = (-10e-3, 20e-3)
"""Time from the stamp of a pulse to its light, in seconds."""

STAMP_JITTER_S = (0.5e-3, 3e-3)
"""Standard deviation of a stamp by itself, in seconds."""

BACKLASH_DEG = (0.05, 0.2)
"""Backlash between encoder and probe, in degrees; the rig states 0.1."""

WITHOUT_LIGHT = 0.01
"""Share of the pulses that give no light."""

DRIFT_PER_MIN = (-0.08, 0.08)
"""Change of ln energy in a minute."""

PULSES = (1, 128)
"""Pulses averaged, evenly spread in their logarithm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknowns:
    """One rig and one marker."""

    model: AcousticModel
    """The acoustic model of the rig."""
    marker: Absorber
    """The marker, of strength 1."""
    pulses: int
    """Pulses averaged in one acquisition."""


def draw_unknowns(
    rng: np.random.Generator, *, marker_deg: float, lateral_m: float, receiver: ReceiverSettings
) -> Unknowns:
    """Draw a rig and a marker."""
    # The order of the draws is part of the study: another order would give other markers.
    focus_m = None if rng.random() < NO_LENS else float(rng.uniform(*FOCUS_M))
    probe = Probe(
        element_height_m=float(rng.uniform(*ELEMENT_HEIGHT_M)),
        elevation_focus_m=focus_m,
        face_radius_m=float(rng.uniform(*FACE_RADIUS_M)),
    )
    pulse_s = float(rng.uniform(*PULSE_S))
    laser: LaserPulse = RectanglePulse(duration_s=pulse_s) if rng.random() < 0.5 else GaussianPulse(fwhm_s=pulse_s)
    centre_hz = float(rng.uniform(*CENTRE_HZ))
    medium = Medium(
        sound_speed_m_s=float(rng.uniform(*SOUND_SPEED_M_S)),
        attenuation_db_cm_mhz=float(rng.uniform(*ATTENUATION_DB_CM_MHZ)),
    )
    model = AcousticModel(
        probe=probe,
        medium=medium,
        laser=laser,
        band=Band(centre_hz=centre_hz, low_hz=centre_hz - 1.5e6, high_hz=centre_hz + 2.5e6),
        sampling_hz=receiver.sampling_hz,
        samples=receiver.samples,
        trigger_offset_s=float(rng.uniform(*TRIGGER_OFFSET_S)),
    )
    marker = Absorber(
        radius_m=float(rng.uniform(*MARKER_RADIUS_M)),
        angle_deg=marker_deg,
        lateral_m=lateral_m,
        source=GaussianAbsorber(radius_m=log_uniform(rng, *SOURCE_RADIUS_M)),
    )
    return Unknowns(model=model, marker=marker, pulses=round(log_uniform(rng, *PULSES)))


def with_timing(settings: SimulatedSettings, rng: np.random.Generator) -> SimulatedSettings:
    """The settings with what a sweep does not know of stage and laser, drawn."""
    laser = replace(
        settings.laser,
        stamp_delay_s=float(rng.uniform(*STAMP_DELAY_S)),
        stamp_jitter_s=float(rng.uniform(*STAMP_JITTER_S)),
        energy_drift_per_min=float(rng.uniform(*DRIFT_PER_MIN)),
        without_light=WITHOUT_LIGHT,
    )
    backlash_deg = float(rng.uniform(*BACKLASH_DEG))
    stage = replace(settings.stage, backlash_deg=backlash_deg, stated_backlash_deg=settings.stage.backlash_deg)
    return replace(settings, laser=laser, stage=stage)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number that is evenly spread in its logarithm."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))
