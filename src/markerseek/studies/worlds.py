"""The simulated worlds of a study: what is drawn for a trial, and the rig of its searches."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from msgspec import structs

from markerseek import rigs
from markerseek.acoustics import Absorber, AcousticModel
from markerseek.core import Interval
from markerseek.rigs import (
    Scene,
    draw_scene,
    image_peak,
    largest_count,
    rig_in_world,
    scene_curve,
    scene_of,
)
from markerseek.sim import (
    GaussianCurve,
    IntensityCurve,
    LaserSettings,
    PowerCurve,
    RecordedCurve,
    SechCurve,
    SimulatedSettings,
    StainedSpot,
    TwoPeaks,
    tissue_named,
)
from markerseek.studies.study import Cell, CurveSettings, Study
from markerseek.studies.unknowns import (
    LATERAL_M,
    MARKER_RADIUS_M,
    DrawnScene,
    Unknowns,
    draw_extra_sources,
    draw_unknowns,
    with_timing,
)

_LARGEST_COUNTS = 2000.0
"""Largest count in a channel, of all sources and `_NOISE_SIGMAS` of noise; full scale is 2047."""

_STRONGEST_PULSE = 1.15
"""Largest energy over the mean that is expected of a laser with a jitter of 3 %, with some room."""

FORMER_DB = 3.0
"""A former marker on the same rig is so much louder or fainter at most, in dB."""

_NOISE_SIGMAS = 5.0
"""Standard deviations of noise in a channel that the converter must hold beside a source."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What is drawn for a trial, the same for every policy."""

    marker_deg: float
    lateral_m: float
    curve: int
    """Which of the drawn spots it is, at the level of curves."""
    noise_seed: int
    """Seed of all noise; at the level of frames also of the spot."""
    unknowns: Unknowns | None = None
    """The rig and the marker, if the study draws everything; else None."""
    scene: DrawnScene = field(default_factory=DrawnScene)
    """What is beside the marker."""


def draw_trial(study: Study, cell: Cell, trial: int) -> Draw:
    """Draw the marker and the seeds of a trial.

    ``study``, ``cell``, ``trial``: only the seed of the study and the settings of the cell have an effect.
    """
    world = cell.world
    rng = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(cell.digest, trial)))
    search = world.rig.limits.search
    marker = world.rig.marker
    receiver = world.rig.receiver
    # Drawn also where the settings give them: the other random numbers must not depend on that.
    angle_deg, place_m = _draw_position(rng, search)
    marker_deg = angle_deg if marker.angle_deg is None else marker.angle_deg
    lateral_m = place_m if marker.lateral_m is None else marker.lateral_m
    curve = int(rng.integers(world.curve.draws))
    noise_seed = int(rng.integers(2**63))
    unknowns = None
    if study.drawn != "marker":
        unknowns = draw_unknowns(rng, marker_deg=marker_deg, lateral_m=lateral_m, receiver=receiver)
    # Only its angle and lateral position are known where nothing else is drawn, and nothing else is needed.
    beside = Absorber(radius_m=marker.radius_m, angle_deg=marker_deg, lateral_m=lateral_m)
    scene = draw_extra_sources(world.scene, rng, marker=beside if unknowns is None else unknowns.marker, limits=search)
    return Draw(
        marker_deg=marker_deg,
        lateral_m=lateral_m,
        curve=curve,
        noise_seed=noise_seed,
        unknowns=unknowns,
        scene=scene,
    )


def _draw_position(rng: np.random.Generator, search: Interval) -> tuple[float, float]:
    """Return the angle of a marker in degrees, and its lateral position in metres."""
    return float(rng.uniform(search.low_deg, search.high_deg)), float(rng.uniform(-LATERAL_M, LATERAL_M))


def former_rig(study: Study, cell: Cell, trial: int) -> rigs.Rig:
    """Return the rig of a trial with another marker: at another place, and louder or fainter by up to `FORMER_DB`."""
    draw = draw_trial(study, cell, trial)
    settings = cell.world.rig
    rng = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(cell.digest, trial, 1)))
    search = settings.limits.search
    noise = settings.noise
    marker_deg, lateral_m = _draw_position(rng, search)
    noise = structs.replace(noise, peak_snr_db=noise.peak_snr_db + rng.uniform(-FORMER_DB, FORMER_DB))
    unknowns = draw.unknowns
    if unknowns is not None:
        radius_m = float(rng.uniform(*MARKER_RADIUS_M))
        marker = structs.replace(unknowns.marker, angle_deg=marker_deg, lateral_m=lateral_m, radius_m=radius_m)
        unknowns = replace(unknowns, marker=marker)
    former = Draw(
        marker_deg=marker_deg,
        lateral_m=lateral_m,
        curve=draw.curve,
        noise_seed=int(rng.integers(2**63)),
        unknowns=unknowns,
    )
    world = structs.replace(cell.world, rig=structs.replace(settings, noise=noise))
    return study_rig(study, replace(cell, world=world), former)


def expected_angle_deg(
    study: Study, cell: Cell, trial: int, *, truth_deg: float, sigma_deg: float, off_deg: float
) -> float:
    """Return where somebody expects the marker of a trial, in degrees: off by a normal error, and inwards besides."""
    limits = cell.world.rig.limits.search
    rng = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(cell.digest, trial, 2)))
    inwards_deg = -off_deg if truth_deg > limits.centre_deg else off_deg
    # Nobody expects the marker outside of the range that is searched.
    return limits.nearest(truth_deg + inwards_deg + sigma_deg * float(rng.standard_normal()))


def study_rig(study: Study, cell: Cell, draw: Draw) -> rigs.Rig:
    """Return the rig of a trial, at rest at its start."""
    settings = cell.world.rig
    if draw.unknowns is not None:
        return _drawn_rig(study, settings, draw.unknowns, draw)
    if study.level == "frames":
        marker = structs.replace(settings.marker, angle_deg=draw.marker_deg, lateral_m=draw.lateral_m)
        return rigs.simulated(seed=draw.noise_seed, settings=structs.replace(settings, marker=marker))
    curve, images_cells = intensity_curve(cell.world.curve, settings, seed=study.seed, draw=draw.curve)
    second = draw.scene.second
    if curve is not None and second is not None:
        curve = TwoPeaks(curve=curve, apart_deg=second.angle_deg - draw.marker_deg, relative=second.strength)
    return rigs.of_intensities(
        seed=draw.noise_seed,
        curve=curve,
        marker_deg=draw.marker_deg,
        cells=images_cells,
        settings=settings,
        noise_stated=cell.world.curve.noise_stated,
    )


def hidden_noise(study: Study, cell: Cell, draw: Draw, *, sweep: bool) -> str | None:
    """`Scene.hidden_noise` of a trial with everything drawn; other rigs refuse such noise themselves."""
    if draw.unknowns is None:
        return None
    settings = _drawn_settings(study, cell.world.rig, draw.unknowns)
    scene = _scene(draw.unknowns, settings, draw.scene, np.random.default_rng(draw.noise_seed))
    return scene.hidden_noise(settings, pulses=1 if sweep else settings.laser.pulses)


def _drawn_settings(study: Study, settings: SimulatedSettings, unknowns: Unknowns) -> SimulatedSettings:
    """Return the settings with what is drawn of them."""
    settings = structs.replace(settings, probe=unknowns.model.probe)
    if study.sweeps:
        # The peak SNR is that of an average of as many pulses as the rig's file names: of one, it must not be drawn.
        return structs.replace(settings, receiver=structs.replace(settings.receiver, single_pulses=True))
    return structs.replace(settings, laser=structs.replace(settings.laser, pulses=unknowns.pulses))


def _drawn_rig(study: Study, settings: SimulatedSettings, unknowns: Unknowns, draw: Draw) -> rigs.Rig:
    """Return the rig with everything drawn."""
    rng = np.random.default_rng(draw.noise_seed)
    settings = _drawn_settings(study, settings, unknowns)
    if draw.scene.motion is not None:
        settings = structs.replace(settings, motion=draw.scene.motion)
    if study.drawn == "everything-and-timing":
        settings = with_timing(settings, np.random.default_rng((draw.noise_seed, 1)))
    return rig_in_world(
        _scene(unknowns, settings, draw.scene, rng).world(settings, rng),
        settings,
        "simulated frames, all unknowns drawn",
        truth_deg=unknowns.marker.angle_deg if settings.marker.present else None,
        rng=rng,
    )


def _scene(unknowns: Unknowns, settings: SimulatedSettings, beside: DrawnScene, rng: np.random.Generator) -> Scene:
    """Return the marker, tissue and what is beside them, in counts; every other source as strong as it was drawn.

    The gain is that of the marker alone, lowered where another source would exceed full scale.
    """
    material = tissue_named(settings.tissue)
    marker = unknowns.marker
    if material.spot.count == 1:
        material = structs.replace(material, spot=StainedSpot(grain=marker.source))
    model = replace(unknowns.model, reverberation=beside.reverberation or material.reverberation)
    scene = scene_of(material, marker, settings, model, rng)
    drawn = beside.clutter if beside.second is None else (beside.second, *beside.clutter)
    others = [_scaled_to_level(each, model, marker_peak=scene.peak) for each in drawn]
    noise = scene.noise
    total = math.hypot(noise.white_sigma, noise.coloured_sigma)
    peak_counts = scene.peak_counts
    if settings.receiver.single_pulses:
        total *= math.sqrt(settings.laser.pulses)
    # A source near the probe reaches fewer channels, and must be stronger in each to be as loud in the image. Its sound
    # may overlap the marker's.
    loudest = peak_counts + max((largest_count([each], model, each) for each in others), default=0.0)
    # Saturation that was asked for stays.
    gain = min(1.0, max(_LARGEST_COUNTS, peak_counts) / (_STRONGEST_PULSE * loudest + _NOISE_SIGMAS * total))
    return replace(
        scene,
        absorbers=tuple(structs.replace(each, strength=each.strength * gain) for each in (*scene.absorbers, *others)),
        noise=structs.replace(noise, white_sigma=noise.white_sigma * gain, coloured_sigma=noise.coloured_sigma * gain),
    )


def _scaled_to_level(source: Absorber, model: AcousticModel, *, marker_peak: float) -> Absorber:
    """Return the source, scaled so that its peak in the image is the drawn ratio of the marker's."""
    peak = image_peak([structs.replace(source, strength=1.0)], model, angle_deg=source.angle_deg)
    return structs.replace(source, strength=source.strength * marker_peak / peak)


def intensity_curve(
    curve: CurveSettings, rig: SimulatedSettings, *, seed: int, draw: int = 0
) -> tuple[IntensityCurve | None, int]:
    """Return the noise-free curve of a world over the angle off the marker, and the independent cells of its images.

    An acoustic curve is computed once for settings with the same curve, and cached; the marker is at the middle
    of the array. None is a closed form without a marker.

    ``seed``, ``draw``: seed of the study, and the number of the spot that is drawn from it.
    """
    if curve.family == "acoustic":
        tissue = tissue_named(rig.tissue)
        # One spot without clutter has no randomness: all draws share one curve.
        drawn = tissue.clutter is not None or (tissue.spot.count > 1 and rig.marker.source_radius_m is None)
        return _acoustic_curve(_same_curve(rig), seed, draw if drawn else 0)
    if not rig.marker.present:
        return None, rigs.USUAL_CELLS
    if curve.family == "gaussian":
        return GaussianCurve(fwhm_deg=curve.fwhm_deg), rigs.USUAL_CELLS
    if curve.family == "sech":
        return SechCurve(fwhm_deg=curve.fwhm_deg), rigs.USUAL_CELLS
    return PowerCurve(fwhm_deg=curve.fwhm_deg, power=curve.power), rigs.USUAL_CELLS


def _same_curve(rig: SimulatedSettings) -> SimulatedSettings:
    """Return the settings with everything that does not change the curve at its default: the key of the cache."""
    return SimulatedSettings(
        tissue=rig.tissue,
        marker=structs.replace(rig.marker, angle_deg=0.0, lateral_m=0.0),
        probe=rig.probe,
        laser=LaserSettings(pulse_s=rig.laser.pulse_s),
        receiver=structs.replace(rig.receiver, readout_s=0.0),
    )


@lru_cache(maxsize=256)
def _acoustic_curve(rig: SimulatedSettings, seed: int, draw: int) -> tuple[RecordedCurve, int]:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(draw,)))
    return scene_curve(draw_scene(rig, rng))
