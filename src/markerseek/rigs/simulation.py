"""Assembles simulated rigs: in a world of channel data or of intensities, or with a spot of light that is moved.

A spot of light is moved while the rig runs, as in a registration.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import SupportsFloat, SupportsIndex, TypeAlias

import msgspec
import numpy as np
from msgspec import structs

from markerseek.acoustics import Absorber
from markerseek.core import ConfigError, RigFacts, SimulationOptions
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.rigs.rig import Rig, fingerprint_of, with_probe
from markerseek.rigs.scene import Scene, draw_scene, image_reader
from markerseek.scan import Scanner
from markerseek.signals import IntensityReader
from markerseek.sim import (
    CurveWorld,
    IntensityCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    SimulatedStage,
    SimulatedWorld,
    VirtualClock,
    World,
    hashable_values,
    with_options,
)

DARK_FRAMES = 3
"""Number of frames without laser before a checked search, on a rig that can take them."""

USUAL_CELLS = 460_000
"""Approximate number of independent envelope cells in an image of the simulated probe."""


class SimulatedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="simulated"):
    """Arguments of `markerseek.rigs.simulated`."""

    seed: int
    settings: SimulatedSettings
    pace: float

    def __post_init__(self) -> None:
        if not self.seed >= 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or a positive whole number")


def require_seed(seed: SupportsIndex) -> int:
    """Return the seed as a checked int; journals and banks store 63 bits."""
    # bool is an int in Python, and seed=True is a mistake.
    whole = isinstance(seed, SupportsIndex) and not isinstance(seed, bool)
    if not whole or not 0 <= operator.index(seed) < 2**63:
        raise ConfigError(f"seed is {seed!r}, it must be a whole number from 0 to 2**63 - 1")
    return operator.index(seed)


def rig_in_world(
    world: SimulatedWorld,
    settings: SimulatedSettings,
    what: str,
    *,
    truth_deg: float | None,
    rng: np.random.Generator,
    seed: int | None = None,
    clock: VirtualClock | None = None,
    recipe: SimulatedRecipe | None = None,
    resumed_after: int = 0,
) -> Rig:
    """Assemble simulated devices in a world.

    ``settings``: settings of stage, laser, receiver and limits. ``what``: what is simulated, for its description.
    ``rng``: random generator of the world. ``seed``: its seed, if known. ``clock``: None: a new one, which does not
    wait. ``recipe``: arguments that make the same rig again, for a journal. ``resumed_after``: as in `simulated`.
    """
    if resumed_after:
        rng.bit_generator.state = np.random.PCG64((seed or 0, resumed_after)).state
    clock = clock or VirtualClock()
    imaging = None
    if not isinstance(world, CurveWorld):
        # Not the tissue's sound speed: a user images with a preset, and the error is part of the result.
        imaging = image_reader(settings.probe.array, sampling_hz=settings.receiver.sampling_hz)
    stage = SimulatedStage(world=world, clock=clock, motion=settings.stage, travel=settings.limits.travel)
    laser = SimulatedLaser(world=world, clock=clock, light=settings.laser, probe_deg=stage.probe_deg, rng=rng)
    receiver = SimulatedReceiver(
        world=world,
        clock=clock,
        readout_s=settings.receiver.readout_s,
        meter_noise=settings.laser.energy_meter_noise,
        frame_period_s=settings.receiver.frame_period_s,
        rng=rng,
    )
    scanner = Scanner(
        stage=stage,
        laser=laser,
        receiver=receiver,
        reader=imaging or IntensityReader(),
        clock=clock,
        guard=Guard(limits=settings.limits, firing=FiringLimits(), admission=Admission()),
        pulses=settings.laser.pulses,
        # A simulated laser emits no light, so that no person has to arm the rig.
        arms_itself=True,
    )
    facts = RigFacts(
        kind="simulated",
        description=f"{what}, peak SNR {settings.noise.peak_snr_db:g} dB" + ("" if seed is None else f", seed {seed}"),
        fingerprint=fingerprint_of(hashable_values(settings)),
        search=settings.limits.search,
        face_radius_m=settings.probe.face_radius_m,
        motion_mm=settings.motion.stated_mm,
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
        spot=settings.spot,
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
    """Return a simulated rig that returns intensities instead of frames, hundreds of times faster, for studies.

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
        "simulated intensities",
        seed=seed,
        truth_deg=marker_deg if settings.marker.present and curve is not None else None,
        rng=rng,
    )
    return rig if noise_stated else replace(rig, dark_frames=0)


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
    """Return a rig in a simulated world; the same seed and settings give the same frames.

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
    seed = require_seed(seed)
    pace = float(pace)
    if settings is None:
        settings = SimulatedSettings()
    elif not isinstance(settings, SimulatedSettings):
        # Here: with the keys of a rig file come those of all drivers.
        from markerseek.rigs.rig_file import read_simulated

        settings = read_simulated(Path(settings), cure="a simulated rig is needed: name a file of kind simulated")
    chosen = SimulationOptions(
        tissue=tissue,
        no_marker=no_marker,
        marker_deg=_number(marker_deg),
        second_marker_deg=_number(second_marker_deg),
        snr_db=_number(snr_db),
        readout_s=_number(readout_s),
    )
    settings = with_options(settings, chosen)
    rng = np.random.default_rng(seed)
    clock = VirtualClock(pace=pace, beat=beat)
    scene = draw_scene(settings, rng)
    hidden = scene.hidden_noise(settings, pulses=settings.laser.pulses)
    if hidden is not None:
        raise ConfigError(hidden)
    rig = rig_in_world(
        scene.world(settings, rng),
        settings,
        scene.description,
        seed=seed,
        truth_deg=scene.marker.angle_deg if settings.marker.present else None,
        rng=rng,
        clock=clock,
        recipe=SimulatedRecipe(seed=seed, settings=settings, pace=pace),
        resumed_after=resumed_after,
    )
    if scene.second is None:
        return rig
    description = f"{rig.facts.description}, a second marker at {scene.second.angle_deg:.2f} deg"
    return replace(rig, facts=structs.replace(rig.facts, description=description))


def _number(value: SupportsFloat | None) -> float | None:
    return None if value is None else float(value)


DrawExtraSources: TypeAlias = Callable[[Scene, np.random.Generator], tuple[Absorber, ...]]
"""Draws the sources beside the marker after each of its moves, with strengths in counts."""


@dataclass(slots=True, kw_only=True)
class MovableMarker:
    """A simulated rig and the world in which its marker is moved."""

    rig: Rig
    """The rig; another one, with the same devices, after each move."""
    world: World
    settings: SimulatedSettings
    rng: np.random.Generator
    beside: DrawExtraSources | None = None

    def move(self, *, angle_deg: float, radius_m: float, lateral_m: float) -> Rig:
        """Put the spot of light elsewhere, draw new clutter, and return the rig."""
        scene = marker_scene(self.settings, self.rng, angle_deg=angle_deg, radius_m=radius_m, lateral_m=lateral_m)
        others = () if self.beside is None else self.beside(scene, self.rng)
        self.world.replace_absorbers((*scene.absorbers, *others))
        self.rig = replace(self.rig, facts=structs.replace(self.rig.facts, truth_deg=angle_deg))
        return self.rig


def movable(
    seed: SupportsIndex,
    settings: SimulatedSettings,
    *,
    pace: float = 0.0,
    beat: Callable[[], None] | None = None,
    beside: DrawExtraSources | None = None,
) -> MovableMarker:
    """Return a simulated rig of channel data whose marker can be moved.

    Gain and noise are those of a marker in the middle of the range. ``pace`` and ``beat``: as of `simulated`.
    ``beside``: draws what is beside the marker again for each move; None: only the clutter of the material.
    """
    seed = require_seed(seed)
    rng = np.random.default_rng(seed)
    middle_deg = settings.limits.search.centre_deg
    scene = marker_scene(settings, rng, angle_deg=middle_deg, radius_m=settings.marker.radius_m, lateral_m=0.0)
    world = scene.world(settings, rng)
    rig = rig_in_world(
        world,
        settings,
        scene.description,
        seed=seed,
        truth_deg=None,
        rng=rng,
        clock=VirtualClock(pace=pace, beat=beat),
    )
    return MovableMarker(rig=rig, world=world, settings=settings, rng=rng, beside=beside)


def marker_scene(
    settings: SimulatedSettings, rng: np.random.Generator, *, angle_deg: float, radius_m: float, lateral_m: float
) -> Scene:
    """Draw the scene of a simulated rig with its marker at this place."""
    marker = structs.replace(settings.marker, angle_deg=angle_deg, radius_m=radius_m, lateral_m=lateral_m, present=True)
    return draw_scene(structs.replace(settings, marker=marker), rng)
