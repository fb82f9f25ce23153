"""Assembles simulated rigs: with frames, or with intensities only."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import SupportsFloat, SupportsIndex

import numpy as np

from markerseek.acoustics import Absorber, Digitiser
from markerseek.core import ConfigError, Reader, RigFacts
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs.recipe import SimulatedRecipe
from markerseek.rigs.rig import Rig, fingerprint, with_probe
from markerseek.rigs.rig_file import read_rig_file
from markerseek.rigs.scene import draw_marker, draw_scene, image_reader
from markerseek.scan import Scanner
from markerseek.signals import AnyImageReader, IntensityReader, ProbePreset, SpareReader
from markerseek.sim import (
    BModeSettings,
    BModeWorld,
    CurveWorld,
    IntensityCurve,
    RFWorld,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    SimulatedState,
    SimulatedWorld,
    VirtualClock,
    World,
)
from markerseek.vision import TipReader, TipSettings

LEAST_NOISE_COUNTS = 0.25
"""Least noise of a simulated channel in counts that survives rounding by the converter."""

DARK_FRAMES = 3
"""Frames without laser before a guarded search, on a rig that can take them."""

USUAL_CELLS = 460_000
"""Approximate number of independent envelope cells in an image of the simulated probe."""


def simulated(
    *,
    seed: SupportsIndex,
    tissue: str | None = None,
    marker_deg: SupportsFloat | None = None,
    settings: SimulatedSettings | str | Path | None = None,
    pace: SupportsFloat = 0.0,
    beat: Callable[[], None] | None = None,
) -> Rig:
    """A rig in a simulated world; the same seed and settings give the same frames.

    Parameters
    ----------
    seed
        Seed of everything that is drawn, from 0 to 2**63 - 1.
    tissue
        Name of a simulated material, instead of that of the settings.
    marker_deg
        Angle of the marker in degrees, instead of that of the settings.
    settings
        All other settings, or the path of a rig file (kind simulated).
    pace
        Real seconds per virtual second; 0 does not wait.
    beat
        Called while a device works, as of `markerseek.sim.VirtualClock`.

    Raises
    ------
    ConfigError
        If a setting cannot be used.
    """
    seed, pace = _seed(seed), float(pace)
    if not isinstance(settings, SimulatedSettings):
        settings = SimulatedSettings() if settings is None else _simulated_file(Path(settings))
    if tissue is not None:
        settings = replace(settings, tissue=tissue)
    if marker_deg is not None:
        settings = replace(settings, marker=replace(settings.marker, angle_deg=float(marker_deg)))
    rng = np.random.default_rng(seed)
    if settings.receiver.data == "b-mode":
        return _tip_rig(seed, settings, pace=pace, rng=rng)
    scene = draw_scene(settings, rng)
    step = math.hypot(scene.noise.white_sigma, scene.noise.coloured_sigma)
    if not step >= LEAST_NOISE_COUNTS:
        most_db = settings.noise.peak_snr_db + 20 * math.log10(step / LEAST_NOISE_COUNTS)
        raise ConfigError(
            f"noise: peak_snr_db is {settings.noise.peak_snr_db:g} dB, which leaves {step:.2g} counts of noise in "
            f"a channel: below {LEAST_NOISE_COUNTS} the steps of the converter hide it; lower peak_snr_db to at most "
            f"{math.floor(most_db)} dB" + ("" if settings.receiver.peak_counts is None else ", or raise peak_counts")
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
    # Not the tissue's sound speed: a user images with a preset, and the error is part of the result.
    imaging: AnyImageReader = image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz)
    seen: SimulatedWorld = world
    description = f"{scene.description}, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}"
    if scene.second is not None:
        description += f", a second marker at {scene.second.angle_deg:.2f} deg"
    if settings.receiver.data == "rf":
        focus_m = settings.receiver.receive_focus_m
        seen, imaging = RFWorld(world=world, receive_focus_m=focus_m), _spare_reader(imaging.preset, focus_m)
        description += f", {imaging.method}"
    b_mode: BModeWorld | None = None
    if settings.receiver.b_mode:
        # The spot of light lies on the surface; nothing is pressed into the tissue.
        level = replace(settings.b_mode, pressed_m=0.0)
        b_mode = _b_mode_world(settings, scene.marker, rng, b_mode=level, tip=False)
        description += ", with B-mode"
    return in_world(
        seen,
        settings,
        clock=VirtualClock(pace=pace, beat=beat),
        reader=imaging,
        imaging=imaging,
        description=description,
        seed=seed,
        truth_deg=scene.marker.angle_deg if settings.marker.present else None,
        rng=rng,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
        b_mode=b_mode,
    )


@lru_cache(maxsize=4)
def _spare_reader(preset: ProbePreset, receive_focus_m: float | None) -> SpareReader:
    """The reader of a machine's lines; cached, because its tables are expensive to compute."""
    return SpareReader(preset, receive_focus_m=receive_focus_m)


def _b_mode_world(
    settings: SimulatedSettings, marker: Absorber, rng: np.random.Generator, *, b_mode: BModeSettings, tip: bool
) -> BModeWorld:
    """Tissue in B-mode with its surface above the marker, or above the tip that is there."""
    return BModeWorld(
        settings=b_mode,
        probe=settings.probe,
        tip_deg=marker.angle_deg,
        tip_radius_m=marker.radius_m,
        tip_lateral_m=marker.lateral_m,
        present=tip,
        start_deg=settings.start_deg,
        rng=rng,
    )


def _tip_rig(seed: int, settings: SimulatedSettings, *, pace: float, rng: np.random.Generator) -> Rig:
    """A rig in B-mode: the tip of an instrument is where the settings put the marker."""
    marker = draw_marker(settings, rng)
    world = _b_mode_world(settings, marker, rng, b_mode=settings.b_mode, tip=settings.marker.present)
    tip = TipSettings(dynamic_range_db=settings.b_mode.dynamic_range_db)
    reader = TipReader(tip)
    rig = in_world(
        world,
        settings,
        clock=VirtualClock(pace=pace),
        reader=reader,
        imaging=None,
        description=f"tool tip on simulated tissue, {reader.method}, seed {seed}",
        seed=seed,
        truth_deg=marker.angle_deg if settings.marker.present else None,
        rng=rng,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
    )
    # The tip echoes without light too: there are no dark frames, and the noise is the tissue beside it.
    return replace(rig, dark_frames=0, tip=tip)


def of_intensities(
    *,
    seed: int,
    curve: IntensityCurve | None,
    marker_deg: float,
    cells: int = USUAL_CELLS,
    settings: SimulatedSettings | None = None,
    noise_stated: bool = True,
) -> Rig:
    """A simulated rig that returns intensities instead of frames, hundreds of times faster, for studies.

    Stage, laser, noise level and limits come from the settings; tissue and probe are contained in the curve.
    Intensities are in units of the noise's standard deviation. A reading has no lateral position or depth, and its
    noise level is exact.

    Parameters
    ----------
    seed
        Seed of noise and energy.
    curve
        Noise-free intensity over the angle off the marker; None: no source.
    marker_deg
        Angle of the marker in degrees.
    cells
        Independent envelope cells of an image.
    settings
        All other settings.
    noise_stated
        Whether dark frames can be taken, and each frame states noise and cells; false is as a CSV of intensities.

    Raises
    ------
    ConfigError
        If a setting cannot be used; bursts of noise need frames.
    """
    settings = settings or SimulatedSettings()
    rng = np.random.default_rng(_seed(seed))
    world = CurveWorld.of_settings(
        settings, curve=curve, marker_deg=marker_deg, cells=cells, rng=rng, noise_stated=noise_stated
    )
    rig = in_world(
        world,
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        imaging=None,
        description=f"simulated intensities, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        seed=seed,
        truth_deg=marker_deg if settings.marker.present and curve is not None else None,
        rng=rng,
    )
    return rig if noise_stated else replace(rig, dark_frames=0)


def _seed(seed: SupportsIndex) -> int:
    """The seed as an int, checked: journals and banks store 63 bits."""
    # bool is an int in Python, and seed=True is a mistake.
    whole = isinstance(seed, SupportsIndex) and not isinstance(seed, bool)
    if not whole or not 0 <= operator.index(seed) < 2**63:
        raise ConfigError(f"seed is {seed!r}, it must be a whole number from 0 to 2**63 - 1")
    return operator.index(seed)


def _simulated_file(path: Path) -> SimulatedSettings:
    settings = read_rig_file(path)
    if not isinstance(settings, SimulatedSettings):
        raise ConfigError(f"{path}: its kind is bench, but a simulated rig is needed; name a file of kind simulated")
    return settings


def in_world(
    world: SimulatedWorld,
    settings: SimulatedSettings,
    *,
    clock: VirtualClock,
    reader: Reader,
    imaging: AnyImageReader | None,
    description: str,
    truth_deg: float | None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    recipe: SimulatedRecipe | None = None,
    b_mode: BModeWorld | None = None,
) -> Rig:
    """Assemble simulated devices in a world; given `rng`, the state of the world can be saved and restored.

    Parameters
    ----------
    world
        Simulated world of the devices.
    settings
        Settings of stage, laser, receiver and limits.
    clock
        Virtual clock.
    reader
        Turns the world's frames into readings.
    imaging
        The same if it makes images; None otherwise.
    description
        Description of the rig.
    truth_deg
        Angle of the marker in degrees; None where there is none.
    seed
        Seed of the world, if it has one.
    rng
        Random generator of the world, for checkpoints.
    recipe
        Arguments to make the same rig again, for a journal.
    b_mode
        The same tissue in B-mode, for an image after each frame; None: none is taken.
    """
    stage = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=settings.limits.travel)
    laser = SimulatedLaser(world=world, clock=clock, rate_hz=settings.laser.rate_hz)
    receiver = SimulatedReceiver(world=world, clock=clock, readout_s=settings.receiver.readout_s, b_mode=b_mode)
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=reader,
        clock=clock,
        guard=Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission()),
        pulses=settings.laser.pulses,
        # Nothing here emits light, so that no person is needed.
        arms_itself=True,
    )
    facts = RigFacts(
        kind="simulated",
        description=description,
        fingerprint=fingerprint(settings),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
        truth_deg=truth_deg,
        seed=seed,
    )
    return Rig(
        facts=with_probe(facts, imaging),
        stage=stage,
        laser=laser,
        receiver=receiver,
        scanner=scanner,
        imaging=imaging,
        dark_frames=DARK_FRAMES,
        recipe=recipe,
        world=None
        if rng is None
        else SimulatedState(world=world, clock=clock, stage=stage, receiver=receiver, rng=rng),
    )
