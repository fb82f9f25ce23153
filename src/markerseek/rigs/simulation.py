"""Assembles simulated rigs with frames: channel data, RF lines, or B-mode images of a tool tip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import SupportsFloat, SupportsIndex

import numpy as np

from markerseek.acoustics import Absorber
from markerseek.core import ConfigError, SimulationOptions
from markerseek.rigs.rig import Rig, SimulatedRecipe
from markerseek.rigs.rig_file import read_simulated
from markerseek.rigs.scene import Scene, draw_marker, draw_scene, image_reader
from markerseek.rigs.simulated_devices import require_seed, rig_in_world
from markerseek.signals import AnyImageReader, ProbePreset, SpareReader
from markerseek.sim import (
    BModeSettings,
    BModeWorld,
    MovingWorld,
    OscillatingMotion,
    RFWorld,
    SimulatedSettings,
    SimulatedWorld,
    VirtualClock,
    with_options,
)
from markerseek.vision import TipReader, TipSettings


def simulated(
    seed: SupportsIndex,
    *,
    tissue: str | None = None,
    no_marker: bool = False,
    marker_deg: SupportsFloat | None = None,
    second_marker_deg: SupportsFloat | None = None,
    snr_db: SupportsFloat | None = None,
    readout_s: SupportsFloat | None = None,
    settings: SimulatedSettings | str | Path | None = None,
    pace: SupportsFloat = 0.0,
    beat: Callable[[], None] | None = None,
    swing: OscillatingMotion | None = None,
    resumed_after: int = 0,
) -> Rig:
    """A rig in a simulated world; the same seed and settings give the same frames.

    Parameters
    ----------
    seed
        Seed of everything that is drawn, from 0 to 2**63 - 1.
    tissue
        Name of a simulated material, instead of that of the settings.
    no_marker
        Whether noise and clutter alone are simulated.
    marker_deg
        Angle of the marker in degrees, instead of that of the settings.
    second_marker_deg
        Angle of a second marker in degrees, as strong, elsewhere along the array.
    snr_db
        Peak SNR of the image with the probe on the marker, in dB, instead of that of the settings.
    readout_s
        Time to read one acquisition, in seconds, instead of that of the settings.
    settings
        All other settings, or the path of a rig file (kind simulated).
    pace
        Real seconds per virtual second; 0 does not wait.
    beat
        Called while a device works, as of `markerseek.sim.VirtualClock`.
    swing
        Moves the marker, with its tissue, once it begins; None: the marker rests.
    resumed_after
        Entries in the record of an earlier process: the scene is the same, and the noise is not repeated.

    Raises
    ------
    ConfigError
        If a setting cannot be used.
    """
    seed, pace = require_seed(seed), float(pace)
    if not isinstance(settings, SimulatedSettings):
        path = None if settings is None else Path(settings)
        settings = read_simulated(path, cure="a simulated rig is needed: name a file of kind simulated")
    chosen = SimulationOptions(
        tissue=tissue,
        no_marker=no_marker,
        marker_deg=_number(marker_deg),
        second_marker_deg=_number(second_marker_deg),
        snr_db=_number(snr_db),
        readout_s=_number(readout_s),
    )
    settings = with_options(settings, chosen)
    if swing is not None and (settings.receiver.b_mode or settings.receiver.data == "b-mode"):
        raise ConfigError("receiver: B-mode of a marker that moves is not simulated; leave b_mode out")
    rng, clock = np.random.default_rng(seed), VirtualClock(pace=pace, beat=beat)
    if settings.receiver.data == "b-mode":
        return _tip_rig(seed, settings, pace=pace, clock=clock, rng=rng)
    scene = _scene(settings, rng)
    world = scene.world(settings, rng)
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
    b_mode = _b_mode_under(settings, scene.marker, rng)
    if b_mode is not None:
        description += ", with B-mode"
    if swing is not None:
        seen = MovingWorld(seen, swing)
        description += f", moving at {swing.speed_deg_s:g} deg/s"
    return rig_in_world(
        seen,
        settings,
        clock=clock,
        reader=imaging,
        description=description,
        seed=seed,
        truth_deg=scene.marker.angle_deg if settings.marker.present else None,
        rng=rng,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
        b_mode=b_mode,
        resumed_after=resumed_after,
    )


def _number(value: SupportsFloat | None) -> float | None:
    return None if value is None else float(value)


def _scene(settings: SimulatedSettings, rng: np.random.Generator) -> Scene:
    """A scene with noise that the steps of the converter do not hide."""
    scene = draw_scene(settings, rng)
    problem = scene.hidden_noise(settings, pulses=settings.laser.pulses)
    if problem is not None:
        raise ConfigError(problem)
    return scene


@lru_cache(maxsize=4)
def _spare_reader(preset: ProbePreset, receive_focus_m: float | None) -> SpareReader:
    """The reader of a machine's lines; cached, because its tables are expensive to compute."""
    return SpareReader(preset, receive_focus_m=receive_focus_m)


def _b_mode_under(settings: SimulatedSettings, marker: Absorber, rng: np.random.Generator) -> BModeWorld | None:
    """The tissue of channel data in B-mode; None where no such images are taken."""
    if not settings.receiver.b_mode:
        return None
    # The spot of light lies on the surface; nothing is pressed into the tissue.
    return _b_mode_world(settings, marker, rng, b_mode=replace(settings.b_mode, pressed_m=0.0), tip=False)


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


def _tip_rig(
    seed: int, settings: SimulatedSettings, *, pace: float, clock: VirtualClock, rng: np.random.Generator
) -> Rig:
    """A rig in B-mode: the tip of an instrument is where the settings put the marker."""
    marker = draw_marker(settings, rng)
    world = _b_mode_world(settings, marker, rng, b_mode=settings.b_mode, tip=settings.marker.present)
    tip = TipSettings(dynamic_range_db=settings.b_mode.dynamic_range_db)
    reader = TipReader(tip)
    rig = rig_in_world(
        world,
        settings,
        clock=clock,
        reader=reader,
        description=f"tool tip on simulated tissue, {reader.method}, seed {seed}",
        seed=seed,
        truth_deg=marker.angle_deg if settings.marker.present else None,
        rng=rng,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
    )
    # The tip echoes without light too: there are no dark frames, and the noise is the tissue beside it.
    return replace(rig, dark_frames=0, tip=tip)
