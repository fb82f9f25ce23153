"""A simulated rig whose spot of light is moved while it runs, as in a registration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import SupportsIndex, TypeAlias

import numpy as np

from markerseek.acoustics import Absorber
from markerseek.rigs.rig import Rig
from markerseek.rigs.scene import Scene, draw_scene, image_reader
from markerseek.rigs.simulated_devices import require_seed, rig_in_world
from markerseek.sim import SimulatedSettings, VirtualClock, World

Beside: TypeAlias = Callable[[Scene, np.random.Generator], tuple[Absorber, ...]]
"""Draws what is beside a marker that was moved, with strengths in counts."""


@dataclass(slots=True, kw_only=True)
class MovableMarker:
    """A simulated rig and the world in which its marker is moved."""

    rig: Rig
    """The rig; another one, with the same devices, after each move."""
    world: World
    settings: SimulatedSettings
    rng: np.random.Generator
    beside: Beside | None = None

    def move(self, *, angle_deg: float, radius_m: float, lateral_m: float) -> Rig:
        """Put the spot of light elsewhere, draw new clutter, and return the rig."""
        scene = marker_scene(self.settings, self.rng, angle_deg=angle_deg, radius_m=radius_m, lateral_m=lateral_m)
        others = () if self.beside is None else self.beside(scene, self.rng)
        self.world.replace_absorbers((*scene.absorbers, *others))
        self.rig = replace(self.rig, facts=replace(self.rig.facts, truth_deg=angle_deg))
        return self.rig


def movable(
    seed: SupportsIndex, settings: SimulatedSettings, *, pace: float = 0.0, beside: Beside | None = None
) -> MovableMarker:
    """A simulated rig of channel data whose marker can be moved.

    Gain and noise are those of a marker in the middle of the range. ``pace``: as of `simulated`. ``beside``: draws what
    is beside the marker again for each move; None: only the clutter of the material.
    """
    rng = np.random.default_rng(require_seed(seed))
    middle_deg = settings.limits.search.centre_deg
    scene = marker_scene(settings, rng, angle_deg=middle_deg, radius_m=settings.marker.radius_m, lateral_m=0.0)
    world = scene.world(settings, rng)
    rig = rig_in_world(
        world,
        settings,
        clock=VirtualClock(pace=pace),
        reader=image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz),
        description=f"{scene.description}, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        seed=require_seed(seed),
        truth_deg=None,
        rng=rng,
    )
    return MovableMarker(rig=rig, world=world, settings=settings, rng=rng, beside=beside)


def marker_scene(
    settings: SimulatedSettings, rng: np.random.Generator, *, angle_deg: float, radius_m: float, lateral_m: float
) -> Scene:
    """Draw the scene of a simulated rig with its marker at this place."""
    marker = replace(settings.marker, angle_deg=angle_deg, radius_m=radius_m, lateral_m=lateral_m, present=True)
    return draw_scene(replace(settings, marker=marker), rng)
