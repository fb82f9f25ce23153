"""Assembles simulated devices in a simulated world."""

from __future__ import annotations

import operator
from typing import SupportsIndex

import numpy as np

from markerseek.core import ConfigError, Reader, RigFacts
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs.recipe import SimulatedRecipe
from markerseek.rigs.rig import Rig, fingerprint, with_probe
from markerseek.scan import Scanner
from markerseek.signals import AnyImageReader
from markerseek.sim import (
    BModeWorld,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    SimulatedState,
    SimulatedWorld,
    VirtualClock,
)

DARK_FRAMES = 3
"""Frames without laser before a guarded search, on a rig that can take them."""


def require_seed(seed: SupportsIndex) -> int:
    """The seed as an int, checked: journals and banks store 63 bits."""
    # bool is an int in Python, and seed=True is a mistake.
    whole = isinstance(seed, SupportsIndex) and not isinstance(seed, bool)
    if not whole or not 0 <= operator.index(seed) < 2**63:
        raise ConfigError(f"seed is {seed!r}, it must be a whole number from 0 to 2**63 - 1")
    return operator.index(seed)


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
