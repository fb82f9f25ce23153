"""One search, one row: drawn from the study, the cell and the number of the trial, and drawn again the same."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import msgspec
import numpy as np

from markerseek import rigs
from markerseek.core import ConfigError, DeviceError, Finished, Found, Refused, Unsure
from markerseek.records.result import answer_name
from markerseek.scan import run
from markerseek.scene import draw_scene, scene_curve
from markerseek.search import build
from markerseek.sim import (
    GaussianCurve,
    IntensityCurve,
    LaserSettings,
    PowerCurve,
    RecordedCurve,
    SechCurve,
    SimulatedSettings,
    tissue_named,
)
from markerseek.studies.study import Cell, CurveSettings, PolicySettings, Study, Value, cells

ANSWERS = ("found", "not found", "ambiguous", "at bound", "unsure", "failed")
"""What a row's search can have ended with; "failed" is a fault of a device, which ends it without an angle."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One search of a study.

    ``row`` of the study with the hash ``study`` is all that is needed to run it again (`run_row`); the columns after it
    say what that was, those after ``noise_seed`` what came out. ``settings`` holds the varied settings of the cell;
    ``acquisitions_most`` was allowed and ``acquisitions`` made. What does not exist is None: the truth where there is
    no marker, everything where a device failed.
    """

    study: str
    row: int
    cell: int
    trial: int
    policy: int
    settings: tuple[tuple[str, Value], ...]
    method: str
    acquisitions_most: int
    as_published: bool
    early_end: bool
    noise_seed: int
    answer: Literal["found", "not found", "ambiguous", "at bound", "unsure", "failed"]
    mean_deg: float | None
    truth_deg: float | None
    error_deg: float | None
    sigma_deg: float | None
    acquisitions: int | None
    refused: int
    travel_deg: float | None
    elapsed_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What chance decides in a trial, the same for every policy.

    Attributes
    ----------
    marker_deg, lateral_m
        Place of the marker.
    curve
        Which of the drawn spots it is, at the level of curves.
    noise_seed
        Seed of all noise; at the level of frames also of the spot.
    """

    marker_deg: float
    lateral_m: float
    curve: int
    noise_seed: int


def draw_trial(study: Study, cell: Cell, trial: int) -> Draw:
    """Draw what chance decides in a trial.

    Parameters
    ----------
    study, cell, trial
        Whose; of the study only the seed counts, and of the cell only its settings.
    """
    world = cell.world
    rng = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(cell.digest, trial)))
    search, marker = world.rig.limits.search, world.rig.marker
    marker_deg = float(rng.uniform(search.low_deg, search.high_deg))
    lateral_m = float(rng.uniform(-20e-3, 20e-3))
    return Draw(
        marker_deg=marker_deg if marker.angle_deg is None else marker.angle_deg,
        lateral_m=lateral_m if marker.lateral_m is None else marker.lateral_m,
        curve=int(rng.integers(world.curve.draws)),
        noise_seed=int(rng.integers(2**63)),
    )


def run_trial(study: Study, cell: Cell, trial: int, policy: int) -> Row:
    """One search and its row.

    Parameters
    ----------
    study, cell, trial, policy
        Which: the last is the number of one of the study's policies.

    Raises
    ------
    ConfigError
        If the settings do not fit together.
    """
    settings = study.policies[policy]
    draw = draw_trial(study, cell, trial)
    rig = study_rig(study, cell, draw)
    finished, refused = _search(study, settings, rig)
    estimate = finished.estimate if finished is not None else None
    mean_deg = estimate.mean_deg if estimate is not None else None
    return Row(
        study=study.digest,
        row=(cell.index * study.trials + trial) * len(study.policies) + policy,
        cell=cell.index,
        trial=trial,
        policy=policy,
        settings=cell.varied,
        method=settings.method,
        acquisitions_most=settings.most,
        as_published=settings.as_published,
        early_end=settings.early_end,
        noise_seed=draw.noise_seed,
        answer="failed" if estimate is None else answer_name(estimate),
        mean_deg=mean_deg,
        truth_deg=rig.truth_deg,
        error_deg=None if mean_deg is None or rig.truth_deg is None else abs(mean_deg - rig.truth_deg),
        sigma_deg=estimate.sigma_deg if isinstance(estimate, Found | Unsure) else None,
        acquisitions=None if finished is None else finished.acquisitions,
        refused=refused,
        travel_deg=None if finished is None else finished.travel_deg,
        elapsed_s=None if finished is None else finished.elapsed_s,
    )


def run_row(study: Study, row: int) -> Row:
    """Row of a study's table by its number, from nothing but the study.

    Raises
    ------
    ConfigError
        If the table has no such row.
    """
    if not 0 <= row < study.rows:
        raise ConfigError(f"row is {row}, the study {study.name} has the rows 0 to {study.rows - 1}")
    place, policy = divmod(row, len(study.policies))
    cell, trial = divmod(place, study.trials)
    return run_trial(study, cells(study)[cell], trial, policy)


def study_rig(study: Study, cell: Cell, draw: Draw) -> rigs.Rig:
    """The rig on which a trial searches, at rest at its start.

    Parameters
    ----------
    study, cell, draw
        Whose, and what chance decided.
    """
    settings = cell.world.rig
    if study.level == "frames":
        marker = replace(settings.marker, angle_deg=draw.marker_deg, lateral_m=draw.lateral_m)
        return rigs.simulated(seed=draw.noise_seed, settings=replace(settings, marker=marker))
    curve, images_cells = intensity_curve(cell.world.curve, settings, seed=study.seed, draw=draw.curve)
    return rigs.of_intensities(
        seed=draw.noise_seed, curve=curve, marker_deg=draw.marker_deg, cells=images_cells, settings=settings
    )


def intensity_curve(
    curve: CurveSettings, rig: SimulatedSettings, *, seed: int, draw: int = 0
) -> tuple[IntensityCurve | None, int]:
    """Noise-free curve of a world over the angle off the marker, and the independent cells of its images.

    An acoustic curve is computed once for settings that sound alike and kept in memory; the marker lies in the middle
    of the array. None is a closed form without a marker.

    Parameters
    ----------
    curve, rig
        Settings of the world.
    seed, draw
        Seed of the study, and the number of the spot that is drawn from it.
    """
    if curve.family == "acoustic":
        tissue = tissue_named(rig.tissue)
        drawn = tissue.clutter is not None or (tissue.spot.count > 1 and rig.marker.source_radius_m is None)
        return _acoustic_curve(_as_heard(rig), seed, draw if drawn else 0)
    if not rig.marker.present:
        return None, rigs.USUAL_CELLS
    if curve.family == "gaussian":
        return GaussianCurve(fwhm_deg=curve.fwhm_deg), rigs.USUAL_CELLS
    if curve.family == "sech":
        return SechCurve(fwhm_deg=curve.fwhm_deg), rigs.USUAL_CELLS
    return PowerCurve(fwhm_deg=curve.fwhm_deg, power=curve.power), rigs.USUAL_CELLS


def _as_heard(rig: SimulatedSettings) -> SimulatedSettings:
    """The settings with all that does not change the curve at its default, so that equal curves are made once."""
    return SimulatedSettings(
        tissue=rig.tissue,
        marker=replace(rig.marker, angle_deg=0.0, lateral_m=0.0),
        probe=rig.probe,
        laser=LaserSettings(pulse_s=rig.laser.pulse_s),
        receiver=replace(rig.receiver, readout_s=0.0),
    )


@lru_cache(maxsize=256)
def _acoustic_curve(rig: SimulatedSettings, seed: int, draw: int) -> tuple[RecordedCurve, int]:
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(draw,)))
    return scene_curve(draw_scene(rig, rng), peak_counts=rig.receiver.peak_counts)


def _search(study: Study, settings: PolicySettings, rig: rigs.Rig) -> tuple[Finished | None, int]:
    """How a search ended, None after a fault of a device, and how many frames were refused."""
    policy = build(
        settings.method,
        limits=rig.limits.search,
        acquisitions=settings.acquisitions,
        as_published=settings.as_published,
        start_deg=rig.stage.angle_deg,
        early_end=settings.early_end,
    )
    refused = 0
    finished = None
    try:
        dark_frames = 0 if settings.as_published else rig.dark_frames
        for event in run(policy, rig.scanner, dark_frames=dark_frames, stay=study.stay):
            if isinstance(event, Refused):
                refused += 1
            elif isinstance(event, Finished):
                finished = event
    except DeviceError:
        return None, refused
    return finished, refused
