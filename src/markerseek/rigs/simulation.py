"""Assembles simulated rigs with frames of channel data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import SupportsFloat, SupportsIndex

import numpy as np

from markerseek.core import ConfigError, SimulationOptions
from markerseek.rigs.rig import Rig, SimulatedRecipe
from markerseek.rigs.rig_file import read_simulated
from markerseek.rigs.scene import Scene, draw_scene, image_reader
from markerseek.rigs.simulated_devices import require_seed, rig_in_world
from markerseek.sim import (
    SimulatedSettings,
    VirtualClock,
    with_options,
)


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
    rng, clock = np.random.default_rng(seed), VirtualClock(pace=pace, beat=beat)
    scene = _scene(settings, rng)
    description = f"{scene.description}, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}"
    if scene.second is not None:
        description += f", a second marker at {scene.second.angle_deg:.2f} deg"
    return rig_in_world(
        scene.world(settings, rng),
        settings,
        clock=clock,
        # Not the tissue's sound speed: a user images with a preset, and the error is part of the result.
        reader=image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz),
        description=description,
        seed=seed,
        truth_deg=scene.marker.angle_deg if settings.marker.present else None,
        rng=rng,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
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
