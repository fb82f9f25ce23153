"""Assembles rigs of simulated devices, in a world that returns frames or in one that returns intensities."""

from __future__ import annotations

import operator
from dataclasses import replace
from typing import SupportsIndex

import numpy as np

from markerseek.core import ConfigError, Reader, RigFacts
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs.rig import Rig, SimulatedRecipe, fingerprint, with_probe
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, IntensityReader
from markerseek.sim import (
    CurveWorld,
    IntensityCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    SimulatedWorld,
    VirtualClock,
)

DARK_FRAMES = 3
"""Number of frames without laser before a checked search, on a rig that can take them."""

USUAL_CELLS = 460_000
"""Approximate number of independent envelope cells in an image of the simulated probe."""


def require_seed(seed: SupportsIndex) -> int:
    """The seed as a checked int; journals and banks store 63 bits."""
    # bool is an int in Python, and seed=True is a mistake.
    whole = isinstance(seed, SupportsIndex) and not isinstance(seed, bool)
    if not whole or not 0 <= operator.index(seed) < 2**63:
        raise ConfigError(f"seed is {seed!r}, it must be a whole number from 0 to 2**63 - 1")
    return operator.index(seed)


def rig_in_world(
    world: SimulatedWorld,
    settings: SimulatedSettings,
    *,
    clock: VirtualClock,
    reader: Reader,
    description: str,
    truth_deg: float | None,
    rng: np.random.Generator,
    seed: int | None = None,
    recipe: SimulatedRecipe | None = None,
    resumed_after: int = 0,
) -> Rig:
    """Assemble simulated devices in a world.

    ``settings``: settings of stage, laser, receiver and limits. ``reader``: turns the world's frames into readings.
    ``rng``: random generator of the world. ``seed``: its seed, if known. ``recipe``: arguments that make the same rig
    again, for a journal. ``resumed_after``: as in `simulated`.
    """
    if resumed_after:
        rng.bit_generator.state = np.random.PCG64((seed or 0, resumed_after)).state
    imaging = reader if isinstance(reader, ImageReader) else None
    stage = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=settings.limits.travel)
    light = settings.laser
    laser = SimulatedLaser(
        world=world,
        clock=clock,
        rate_hz=light.rate_hz,
        energy_spread=light.energy_spread,
        energy_drift_per_min=light.energy_drift_per_min,
        true_delay_s=light.stamp_delay_s,
        delay_sigma_s=light.stamp_delay_sigma_s,
        stamp_jitter_s=light.stamp_jitter_s,
        without_light=light.without_light,
        probe_deg=stage.probe_deg,
        rng=rng,
    )
    receiver = SimulatedReceiver(
        world=world,
        clock=clock,
        readout_s=settings.receiver.readout_s,
        meter_noise=light.energy_meter_noise,
        frame_period_s=settings.receiver.frame_period_s,
        rng=rng,
    )
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=reader,
        clock=clock,
        guard=Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission()),
        pulses=settings.laser.pulses,
        # A simulated laser emits no light, so that no person has to arm the rig.
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
    )


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

    ``seed``: seed of noise and energy. ``curve``: noise-free intensity over the angle off the marker; None: no source.
    ``cells``: independent envelope cells of an image. ``noise_stated``: whether dark frames can be taken, and each
    frame states noise and cells; if false, the rig gives as much as a CSV of intensities.
    """
    settings = settings or SimulatedSettings()
    rng = np.random.default_rng(require_seed(seed))
    world = CurveWorld(settings, curve=curve, marker_deg=marker_deg, cells=cells, rng=rng, noise_stated=noise_stated)
    rig = rig_in_world(
        world,
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        description=f"simulated intensities, peak SNR {settings.noise.peak_snr_db:g} dB, seed {seed}",
        seed=seed,
        truth_deg=marker_deg if settings.marker.present and curve is not None else None,
        rng=rng,
    )
    return rig if noise_stated else replace(rig, dark_frames=0)
