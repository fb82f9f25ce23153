"""Assembly, here and nowhere else: the parts of a rig, put together for a search.

`simulated` makes a rig of a simulated world, `replayed` one of a recorded scan. Both run under the same `Scanner`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Band, Digitiser, Noise, RectanglePulse
from markerseek.core import ChannelFrame, ConfigError, FrameHeader, Laser, Receiver, Stage
from markerseek.guard import Admission, FiringLimits, Limits, Permits
from markerseek.records.banks import FrameBank, read_bank
from markerseek.records.replay import IntensityReader, ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.scan import Scanner
from markerseek.signals import PRESET_NAMES, ImageReader, beamformed_sigma, probe_preset
from markerseek.sim import (
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    Tissue,
    VirtualClock,
    World,
    tissue_named,
)

DARK_FRAMES = 3
"""Frames without laser before a guarded search, on a rig that can take them."""

_MOST_COUNTS = 30_000
"""Height to which the noise-free frame is blown up to measure its image without rounding errors, in counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Everything that a search needs.

    Attributes
    ----------
    kind
        Whether it is simulated or replays a recording.
    description
        What it is, in words.
    stage, laser, receiver
        Its devices.
    scanner
        Measures with them.
    imaging
        Imaging chain of its channel data; None where there are intensities only.
    dark_frames
        Frames without laser that a search should begin with; 0 where it cannot take any.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres; None where it is not known.
    truth_deg
        Angle of the marker in degrees, where it is known: the truth of a simulation, or the reference of a recording.
    """

    kind: Literal["simulated", "replayed"]
    description: str
    stage: Stage
    laser: Laser
    receiver: Receiver
    scanner: Scanner
    imaging: ImageReader | None
    dark_frames: int
    face_radius_m: float | None
    truth_deg: float | None

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""
        return self.scanner.limits

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return self.kind == "simulated"


def simulated(
    *,
    seed: int,
    tissue: str | None = None,
    marker_deg: float | None = None,
    settings: SimulatedSettings | None = None,
    pace: float = 0.0,
) -> Rig:
    """A rig in a simulated world; the same seed and settings give the same frames.

    Parameters
    ----------
    seed
        Seed of everything that is drawn.
    tissue
        Name of a simulated material, instead of that of the settings.
    marker_deg
        Angle of the marker in degrees, instead of that of the settings.
    settings
        All the rest.
    pace
        Real seconds for a virtual one; 0 does not wait.

    Raises
    ------
    ConfigError
        If a setting cannot be used.
    """
    settings = settings or SimulatedSettings()
    if tissue is not None:
        settings = replace(settings, tissue=tissue)
    if marker_deg is not None:
        settings = replace(settings, marker=replace(settings.marker, angle_deg=marker_deg))
    material = tissue_named(settings.tissue)
    rng = np.random.default_rng(seed)
    imaging = ImageReader(probe_preset(PRESET_NAMES[0]))
    model = _model(settings, material)
    marker = _draw_marker(settings, rng)
    spot, noise = _scaled(material.spot.draw(marker, rng), marker, settings, model, imaging)
    absorbers = spot if settings.marker.present else []
    if material.clutter is not None:
        clutter = material.clutter.draw(rng)
        loud = settings.receiver.peak_counts / _loudness([marker], model, marker)
        absorbers = absorbers + [replace(weak, strength=weak.strength * loud) for weak in clutter]
    clock = VirtualClock(pace=pace)
    world = World(
        model=model,
        absorbers=absorbers,
        noise=noise,
        digitiser=Digitiser(),
        energy_jitter=settings.laser.energy_jitter,
        start_deg=settings.start_deg,
        rng=rng,
    )
    stage = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=settings.limits.travel)
    laser = SimulatedLaser(world=world, clock=clock, rate_hz=settings.laser.rate_hz)
    receiver = SimulatedReceiver(world=world, clock=clock, readout_s=settings.receiver.readout_s)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging,
        clock=clock,
        limits=settings.limits,
        permits=Permits(FiringLimits()),
        admission=Admission(),
        pulses=settings.laser.pulses,
    )
    return Rig(
        kind="simulated",
        description=f"{material.description}, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=DARK_FRAMES,
        face_radius_m=settings.probe.face_radius_m,
        truth_deg=marker.angle_deg if settings.marker.present else None,
    )


def replayed(path: Path, *, probe: str = PRESET_NAMES[0], reference_deg: float | None = None) -> Rig:
    """A rig that plays back a recorded scan; its search range is the range recorded.

    Parameters
    ----------
    path
        CSV of ``angle_deg,intensity``, or a folder with one sub-folder of SonixDAQ files per angle.
    probe
        Preset of the imaging chain, for channel data.
    reference_deg
        Angle of the marker that was found otherwise, in degrees, to be compared with.

    Raises
    ------
    RecordError
        If the recording cannot be read.
    ConfigError
        If the preset is unknown, or the reference is no finite number.
    """
    if reference_deg is not None and not math.isfinite(reference_deg):
        raise ConfigError(f"reference_deg is {reference_deg} deg, it must be a finite number")
    bank = read_bank(path)
    stage = ReplayStage(bank)
    laser = ReplayLaser()
    receiver = ReplayReceiver(stage=stage, bank=bank)
    frames = isinstance(bank, FrameBank)
    imaging = ImageReader(probe_preset(probe)) if frames else None
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging or IntensityReader(),
        clock=VirtualClock(),
        limits=Limits(search=bank.range, travel=bank.range),
        permits=Permits(FiringLimits()),
        # What was recorded cannot be taken again with less gain: saturation and dead channels are borne.
        admission=Admission(saturated_limit=1.0, dead_limit=1.0),
        arrival_deg=max(np.diff(bank.angles_deg)) / 2 * (1 + 1e-9) if frames else 1e-9,
    )
    return Rig(
        kind="replayed",
        description=f"{path}, {len(bank.angles_deg)} angles",
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=0,
        face_radius_m=None,
        truth_deg=reference_deg,
    )


def _model(settings: SimulatedSettings, material: Tissue) -> AcousticModel:
    return AcousticModel(
        probe=settings.probe,
        medium=material.medium,
        laser=RectanglePulse(duration_s=settings.laser.pulse_s),
        sampling_hz=settings.receiver.sampling_hz,
        samples=settings.receiver.samples,
        trigger_offset_s=settings.receiver.trigger_offset_s,
        reverberation=material.reverberation,
    )


def _draw_marker(settings: SimulatedSettings, rng: np.random.Generator) -> Absorber:
    """Place of the marker of the settings, what they leave open drawn; of strength 1."""
    search = settings.limits.search
    angle_deg, lateral_m = rng.uniform(search.low_deg, search.high_deg), rng.uniform(-20e-3, 20e-3)
    marker = settings.marker
    return Absorber(
        radius_m=marker.radius_m,
        angle_deg=angle_deg if marker.angle_deg is None else marker.angle_deg,
        lateral_m=lateral_m if marker.lateral_m is None else marker.lateral_m,
    )


def _scaled(
    spot: list[Absorber], marker: Absorber, settings: SimulatedSettings, model: AcousticModel, imaging: ImageReader
) -> tuple[list[Absorber], Noise]:
    """The spot so strong that it fills the converter as set, and noise for the peak SNR as set, both in counts.

    The peak SNR is that of the image: the noise-free envelope peak with the probe on the marker, over the standard
    deviation of the beamformed noise (`markerseek.signals.beamformed_sigma`).
    """
    heard = model.channel_data(spot, angle_deg=marker.angle_deg)
    largest = _loudness(spot, model, marker)
    header = FrameHeader(sequence=0, token="", pulses=0, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    counts = np.rint(heard * (_MOST_COUNTS / largest)).astype(np.int16)
    frame = ChannelFrame(header=header, samples=counts, sampling_hz=model.sampling_hz)
    peak = imaging.read(frame).intensity * settings.receiver.peak_counts / _MOST_COUNTS
    power = Band().gain(np.linspace(0, model.sampling_hz / 2, 513)) ** 2
    share = settings.noise.coloured
    white, coloured = np.sqrt(1 - share), np.sqrt(share)
    gain = math.hypot(
        beamformed_sigma(white, preset=imaging.preset),
        beamformed_sigma(coloured, preset=imaging.preset, power=power),
    )
    channel_sigma = peak / 10 ** (settings.noise.peak_snr_db / 20) / gain
    noise = Noise(
        white_sigma=channel_sigma * white, coloured_sigma=channel_sigma * coloured, bursts=settings.noise.bursts
    )
    louder = settings.receiver.peak_counts / largest
    return [replace(absorber, strength=absorber.strength * louder) for absorber in spot], noise


def _loudness(absorbers: list[Absorber], model: AcousticModel, marker: Absorber) -> float:
    """Largest value that absorbers give a channel with the probe on the marker."""
    largest = float(np.abs(model.channel_data(absorbers, angle_deg=marker.angle_deg)).max())
    if not largest > 0:
        raise ConfigError(
            f"marker: at radius_m {marker.radius_m} m and lateral_m {marker.lateral_m} m it is not heard in "
            f"{model.samples} samples; move it nearer or record for longer"
        )
    return largest
