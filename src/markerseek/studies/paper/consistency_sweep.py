"""Which curve widths and noises are consistent with the paper's numbers, each alone and all at once, as a map.

A number is consistent with a combination if as many searches of ours as the paper made have a mean as far off, one way
or the other, in more than one of twenty draws: the paper's number, as rounded, lies within the central 95 % of the
means of resampled searches (bootstrap).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core.shapes import Float64
from markerseek.studies.paper.curve_runs import (
    Condition,
    MarkerErrors,
    Trials,
    errors_of_trials,
    study_of,
)
from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.methods import NAMES, ONLINE_STEPS, TABLE_ACQUISITIONS, Name
from markerseek.studies.paper.positions import grid
from markerseek.studies.paper.reported import MATERIALS, reported

RADII_M = (0.15e-3, 0.3e-3, 0.35e-3, 0.4e-3, 0.45e-3, 0.5e-3, 0.8e-3, 1.2e-3)
"""Absorbers that give the widths: from the default to half the stained patch of 5 mm at its waist."""

LEVELS_DB = (20.0, 30.0, 40.0, 50.0, 60.0, 80.0)
"""Peak SNR."""

SWEEPS = (8, 12, 16, 22, 28)
"""N of WA over which its mean error is averaged here; Fig. 5 has all from 8 to 28."""

RESAMPLES = 400
"""Draws of the bootstrap."""

FAMILIES = ("simulation", "offline", "online")


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One number of the paper in the map: where it comes from, of which search, and of how many."""

    key: str
    family: str
    method: Name
    acquisitions: tuple[int, ...]
    searches: int


def checks() -> list[Check]:
    """Numbers that a combination is held against: means of errors, those of single searches and counts left out."""
    every = [
        Check(key="fig5/WA", family="simulation", method="WA", acquisitions=SWEEPS, searches=PAPER_MARKERS),
        Check(key="fig5/TS", family="simulation", method="TS", acquisitions=(28,), searches=PAPER_MARKERS),
        Check(key="fig5/GSS", family="simulation", method="GSS", acquisitions=(28,), searches=PAPER_MARKERS),
    ]
    every += [
        Check(
            key=f"table1/{name}/{material}",
            family="offline",
            method=name,
            acquisitions=(TABLE_ACQUISITIONS,),
            searches=9,
        )
        for material in MATERIALS[:-1]
        for name in NAMES
    ]
    every.append(Check(key="table2/WA", family="online", method="WA", acquisitions=(ONLINE_STEPS,), searches=9))
    for name in ("TS", "GSS"):
        method: Name = "TS" if name == "TS" else "GSS"
        every += [
            Check(key=f"table2/{name}", family="online", method=method, acquisitions=(16,), searches=9),
            Check(key=f"fig7/{name}/28", family="online", method=method, acquisitions=(28,), searches=9),
        ]
    return every


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """One combination of the map.

    Attributes
    ----------
    condition
        Width and noise.
    ours
        Mean error in degrees for each number, by its key.
    consistent
        Whether the paper's number is consistent with it.
    """

    condition: Condition
    ours: dict[str, float]
    consistent: dict[str, bool]

    def share(self, family: str | None) -> tuple[int, int]:
        """Numbers of a family that are consistent, and how many there are; None: of all."""
        found = [self.consistent[check.key] for check in checks() if family in (None, check.family)]
        return sum(found), len(found)

    @property
    def misfit(self) -> float:
        """Sum of the squared logarithms of ours over the paper's, for the three numbers of Fig. 5."""
        return sum(
            math.log(max(self.ours[check.key], 1e-6) / reported(check.key).mean) ** 2
            for check in checks()
            if check.family == "simulation"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Radius:
    """Part of the sweep: one width under every noise."""

    source_radius_m: float
    levels_db: tuple[float, ...]
    trials: int
    repeats: int
    seed: int


def sweep(effort: Effort) -> list[Spot]:
    """All combinations, width by width.

    Parameters
    ----------
    effort
        What may be used.
    """
    radii = RADII_M if effort.share > 0.2 else RADII_M[::3]
    levels_db = LEVELS_DB if effort.share > 0.2 else LEVELS_DB[::2]
    jobs = [
        _Radius(
            source_radius_m=radius_m,
            levels_db=levels_db,
            trials=max(10, round(60 * effort.share)),
            repeats=max(1, round(3 * effort.share)),
            seed=effort.seed,
        )
        for radius_m in radii
    ]
    return [spot for part in effort.each(_spots, jobs, what="consistency, curves") for spot in part]


def _spots(job: _Radius) -> list[Spot]:
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([job.seed, 8])))
    places = [marker.angle_deg for _ in range(job.repeats) for marker in grid(rng)]
    spots = []
    for level_db in job.levels_db:
        condition = Condition(source_radius_m=job.source_radius_m, peak_snr_db=level_db)
        study = study_of(condition, seed=job.seed, trials=job.trials, sweeps=SWEEPS)
        spread = errors_of_trials(Trials(study=study, first=0, last=job.trials))
        placed: list[MarkerErrors] = []
        for marker_deg in places:
            study = study_of(
                condition, seed=job.seed, trials=1, sweeps=(TABLE_ACQUISITIONS,), marker_deg=marker_deg, early=True
            )
            placed += errors_of_trials(Trials(study=study, first=0, last=1))
        spots.append(_spot(condition, spread, placed, rng))
    return spots


def _spot(
    condition: Condition, spread: Sequence[MarkerErrors], placed: Sequence[MarkerErrors], rng: np.random.Generator
) -> Spot:
    ours: dict[str, float] = {}
    consistent: dict[str, bool] = {}
    for check in checks():
        found = spread if check.family == "simulation" else placed
        errors = np.array([np.mean([each[check.method, count] for count in check.acquisitions]) for each in found])
        ours[check.key] = float(errors.mean())
        consistent[check.key] = is_consistent(reported(check.key).mean, errors, searches=check.searches, rng=rng)
    return Spot(condition=condition, ours=ours, consistent=consistent)


def is_consistent(
    paper: float, errors: Float64[np.ndarray, " searches"], *, searches: int, rng: np.random.Generator
) -> bool:
    """Whether a mean of so many searches may be the paper's, as rounded to two digits behind the point.

    The paper's mean and ours are both means of few: the resamples have as many searches as give the variance of the
    difference, 1/(1/n + 1/m).

    Parameters
    ----------
    paper
        The paper's mean in degrees.
    errors
        Errors of our searches in degrees.
    searches
        Number n of searches that the paper made.
    rng
        Source of the resamples.
    """
    count = max(1, round(1 / (1 / searches + 1 / errors.size)))
    means = rng.choice(errors, (RESAMPLES, count)).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return bool(low - 0.005 <= paper <= high + 0.005)
