"""Assembly, here and nowhere else: the parts of a rig, put together for a search.

`simulated` makes a rig of a simulated world, `of_intensities` one of its intensity curve alone, `replayed` one of a
recorded scan. All run under the same `Scanner`.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from markerseek.acoustics import Digitiser
from markerseek.core import ConfigError, Laser, Reader, Receiver, Stage
from markerseek.guard import Admission, FiringLimits, Limits, Permits
from markerseek.records.banks import FrameBank, IntensityBank, read_bank
from markerseek.records.replay import IntensityReader, ReplayLaser, ReplayReceiver, ReplayStage
from markerseek.scan import Scanner
from markerseek.scene import draw_scene, image_reader
from markerseek.signals import PRESET_NAMES, ImageReader, probe_preset
from markerseek.sim import (
    CurveWorld,
    IntensityCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    Surroundings,
    VirtualClock,
    World,
)

LEAST_NOISE_COUNTS = 0.3
"""Least noise of a simulated channel in counts, that the converter still shows."""

DARK_FRAMES = 3
"""Frames without laser before a guarded search, on a rig that can take them."""

USUAL_CELLS = 460_000
"""Independent cells of an image of the simulated probe, about."""


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
        Angle of the marker in degrees in a simulation; None where nobody knows it.
    configuration
        Fingerprint of the settings, or of the recording: the same for equal rigs.
    reference_deg
        Angle that was found otherwise, in degrees, to be compared with; None without one.
    distinct_angles
        Number of angles at which anything can be measured; None where it is any.
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
    configuration: str
    reference_deg: float | None = None
    distinct_angles: int | None = None

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
    rng = np.random.default_rng(seed)
    scene = draw_scene(settings, rng)
    step = math.hypot(scene.noise.white_sigma, scene.noise.coloured_sigma)
    if not step >= LEAST_NOISE_COUNTS:
        raise ConfigError(
            f"noise: peak_snr_db is {settings.noise.peak_snr_db:g} dB, which leaves {step:.2g} counts of noise in a "
            f"channel: below {LEAST_NOISE_COUNTS} the converter's steps swallow it; lower peak_snr_db or raise peak_counts"
        )
    world = World(
        model=scene.model,
        absorbers=scene.absorbers,
        noise=scene.noise,
        digitiser=Digitiser(),
        energy_jitter=settings.laser.energy_jitter,
        start_deg=settings.start_deg,
        rng=rng,
    )
    imaging = image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz)
    return _in_world(
        world,
        settings,
        clock=VirtualClock(pace=pace),
        reader=imaging,
        imaging=imaging,
        description=f"{scene.description}, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        truth_deg=scene.marker.angle_deg if settings.marker.present else None,
    )


def of_intensities(
    *,
    seed: int,
    curve: IntensityCurve | None,
    marker_deg: float,
    cells: int = USUAL_CELLS,
    settings: SimulatedSettings | None = None,
) -> Rig:
    """A simulated rig that hands out intensities instead of frames: hundreds of times as fast, for studies.

    Stage, laser, noise level and limits are those of the settings; tissue and probe are in the curve already.
    Intensities are in units of the noise's standard deviation. A reading knows neither lateral position nor depth, and
    the noise is taken as known exactly.

    Parameters
    ----------
    seed
        Seed of noise and energy.
    curve
        Noise-free intensity over the angle off the marker; None: nothing sounds.
    marker_deg
        Angle of the marker in degrees.
    cells
        Independent envelope cells of an image.
    settings
        All the rest.

    Raises
    ------
    ConfigError
        If a setting cannot be used; bursts of noise need frames.
    """
    settings = settings or SimulatedSettings()
    if settings.noise.bursts is not None:
        raise ConfigError("noise: bursts are simulated in frames only; leave them out, or study frames")
    snr_db = settings.noise.peak_snr_db
    world = CurveWorld(
        curve=curve,
        marker_deg=marker_deg,
        peak=10 ** (snr_db / 20),
        noise_sigma=1.0,
        cells=cells,
        energy_jitter=settings.laser.energy_jitter,
        start_deg=settings.start_deg,
        rng=np.random.default_rng(seed),
    )
    return _in_world(
        world,
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        imaging=None,
        description=f"simulated intensities, peak SNR {snr_db:g} dB, seed {seed}",
        truth_deg=marker_deg if settings.marker.present and curve is not None else None,
    )


def replayed(
    path: Path,
    *,
    probe: str = PRESET_NAMES[0],
    reference_deg: float | None = None,
    between: Literal["nearest", "interpolated"] = "nearest",
) -> Rig:
    """A rig that plays back a recorded scan; its search range is the range recorded.

    Parameters
    ----------
    path
        CSV of ``angle_deg,intensity``, or a folder with one sub-folder of SonixDAQ files per angle.
    probe
        Preset of the imaging chain, for channel data.
    reference_deg
        Angle of the marker that was found otherwise, in degrees, to be compared with.
    between
        What a search gets between two recorded angles: the nearest recorded one, or an intensity interpolated from both
        neighbours, as in the paper. Frames are never interpolated.

    Raises
    ------
    RecordError
        If the recording cannot be read.
    ConfigError
        If the preset is unknown, or the reference is no finite number.
    """
    if reference_deg is not None and not math.isfinite(reference_deg):
        raise ConfigError(f"reference_deg is {reference_deg} deg, it must be a finite number")
    preset = probe_preset(probe)
    bank = read_bank(path)
    stage = ReplayStage(bank, between=between)
    laser = ReplayLaser()
    receiver = ReplayReceiver(stage=stage, bank=bank)
    frames = isinstance(bank, FrameBank)
    imaging = ImageReader(preset) if frames else None
    interpolated = between == "interpolated" and not frames
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
        arrival_deg=1e-9 if interpolated else max(np.diff(bank.angles_deg)) / 2 * (1 + 1e-9),
    )
    return Rig(
        kind="replayed",
        description=f"{path}, {len(bank.angles_deg)} angles" + (", interpolated between them" if interpolated else ""),
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=0,
        face_radius_m=None,
        truth_deg=None,
        configuration=_fingerprint(bank),
        reference_deg=reference_deg,
        distinct_angles=None if interpolated else len(bank.angles_deg),
    )


def _in_world(
    world: Surroundings,
    settings: SimulatedSettings,
    *,
    clock: VirtualClock,
    reader: Reader,
    imaging: ImageReader | None,
    description: str,
    truth_deg: float | None,
) -> Rig:
    """Simulated devices in a world, put together."""
    stage = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=settings.limits.travel)
    laser = SimulatedLaser(world=world, clock=clock, rate_hz=settings.laser.rate_hz)
    receiver = SimulatedReceiver(world=world, clock=clock, readout_s=settings.receiver.readout_s)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=reader,
        clock=clock,
        limits=settings.limits,
        permits=Permits(FiringLimits()),
        admission=Admission(),
        pulses=settings.laser.pulses,
    )
    return Rig(
        kind="simulated",
        description=description,
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=DARK_FRAMES,
        face_radius_m=settings.probe.face_radius_m,
        truth_deg=truth_deg,
        configuration=_fingerprint(settings),
    )


def _fingerprint(of: SimulatedSettings | IntensityBank | FrameBank) -> str:
    """First half of the SHA-256 of the settings or the recording, as JSON."""
    plain = msgspec.json.encode(of, enc_hook=str)
    return hashlib.sha256(plain).hexdigest()[:32]
