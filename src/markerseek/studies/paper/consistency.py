"""Which curve widths and noises are consistent with the paper's numbers, each alone and all at once, as a map.

A number is consistent with a combination if as many searches of ours as the paper made have a mean as far off, one way
or the other, in more than one of twenty draws: the paper's number, as rounded, lies within the central 95 % of the
means of resampled searches (bootstrap).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from markerseek.pictures import HeatMap, heat_maps_figure
from markerseek.studies.paper.curve_runs import (
    Condition,
    Errors,
    Trials,
    errors_of_trials,
    fwhm_deg,
    study_of,
)
from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.fig5 import FITTED
from markerseek.studies.paper.methods import NAMES, ONLINE_STEPS, TABLE_ACQUISITIONS, Name
from markerseek.studies.paper.positions import grid
from markerseek.studies.paper.reported import MATERIALS, reported
from markerseek.studies.paper.section import Cell, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


def consistency(effort: Effort) -> Section:
    """Map of the combinations of width and noise that are consistent with the paper's numbers.

    Parameters
    ----------
    effort
        What may be used.
    """
    spots = sweep(effort)
    best = min(spots, key=lambda spot: spot.misfit)
    return Section(
        name="consistency",
        title="Consistency: which curve widths and noises give the paper's numbers",
        method=(
            (
                f"The published searches on intensity curves of {len(RADII_M)} widths under {len(LEVELS_DB)} noises: "
                "random markers for the simulation, the nine positions for offline and online. A number of the paper "
                "is consistent with a combination if it lies within the central 95 % of the means that as many "
                "searches as the paper made would have. The nine-position numbers have wide intervals; the "
                "simulation's, of 1000 searches, do not."
            ),
            "Left out are the two numbers after 2 acquisitions, which no curve gives, and those of a single search.",
        ),
        tables=(_map_table(spots), _number_table(spots)),
        pictures=(
            Picture(
                name="consistency",
                alt="Maps over curve width and peak SNR of how many numbers of the paper are consistent",
                draw=partial(_draw, spots),
            ),
        ),
        remarks=_remarks(spots, best),
    )


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
        placed: list[Errors] = []
        for marker_deg in places:
            study = study_of(
                condition, seed=job.seed, trials=1, sweeps=(TABLE_ACQUISITIONS,), marker_deg=marker_deg, early=True
            )
            placed += errors_of_trials(Trials(study=study, first=0, last=1))
        spots.append(_spot(condition, spread, placed, rng))
    return spots


def _spot(condition: Condition, spread: Sequence[Errors], placed: Sequence[Errors], rng: np.random.Generator) -> Spot:
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


def _map_table(spots: Sequence[Spot]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for spot in spots:
        counts = [spot.share(family) for family in (*FAMILIES, None)]
        rows.append(
            (
                1e3 * spot.condition.source_radius_m,
                fwhm_deg(spot.condition.source_radius_m),
                spot.condition.peak_snr_db,
                *(f"{some} of {every}" for some, every in counts),
                spot.misfit,
            )
        )
    return Table(
        name="consistency",
        caption="Numbers that are consistent, by family",
        columns=("source_radius_mm", "fwhm_deg", "peak_snr_db", *FAMILIES, "all", "misfit_of_fig5"),
        rows=tuple(rows),
        shown=False,
    )


def _number_table(spots: Sequence[Spot]) -> Table:
    return Table(
        name="consistency_numbers",
        caption="Every number in every combination",
        columns=("fwhm_deg", "peak_snr_db", "number", "paper_deg", "ours_deg", "consistent"),
        rows=tuple(
            (
                fwhm_deg(spot.condition.source_radius_m),
                spot.condition.peak_snr_db,
                key,
                reported(key).mean,
                ours,
                "yes" if spot.consistent[key] else "no",
            )
            for spot in spots
            for key, ours in spot.ours.items()
        ),
        shown=False,
    )


def _remarks(spots: Sequence[Spot], best: Spot) -> tuple[str, ...]:
    remarks = []
    for family in (*FAMILIES, None):
        most = max(spot.share(family)[0] for spot in spots)
        every = spots[0].share(family)[1]
        where = [spot.condition.words for spot in spots if spot.share(family)[0] == most]
        what = f"the {family} numbers" if family is not None else "all of the paper's numbers at once"
        if most == every:
            shown = "; ".join(where[:6]) + ("; and more" if len(where) > 6 else "")
            remarks.append(f"Consistent with {what}: {len(where)} of {len(spots)} combinations ({shown}).")
        else:
            remarks.append(
                f"No combination is consistent with {what}; the most is {most} of {every}, at {'; '.join(where[:3])}."
            )
    numbers = ", ".join(
        f"{check.key.removeprefix('fig5/')} {best.ours[check.key]:.3f}° for {reported(check.key).mean:g}°"
        for check in checks()
        if check.family == "simulation"
    )
    same = best.condition == FITTED
    remarks.append(
        f"Nearest to Fig. 5, by the sum of squared logarithms of the ratios, is {best.condition.words} ({numbers}). "
        + (
            "Fig. 5 is drawn for it."
            if same
            else f"Fig. 5 is drawn for {FITTED.words}, the nearest with the usual seed and number of markers."
        )
    )
    return tuple(remarks)


def _draw(spots: Sequence[Spot]) -> Figure:
    radii = list(dict.fromkeys(spot.condition.source_radius_m for spot in spots))
    levels = list(dict.fromkeys(spot.condition.peak_snr_db for spot in spots))
    by_place: Mapping[tuple[float, float], Spot] = {
        (spot.condition.source_radius_m, spot.condition.peak_snr_db): spot for spot in spots
    }
    maps = []
    for family in (*FAMILIES, None):
        counts = [[by_place[radius, level].share(family) for radius in radii] for level in levels]
        maps.append(
            HeatMap(
                title=f"{family or 'all'}: numbers consistent, of {counts[0][0][1]}",
                across=tuple(f"{fwhm_deg(radius):.1f}" for radius in radii),
                up=tuple(f"{level:g}" for level in levels),
                values=tuple(tuple(some / every for some, every in row) for row in counts),
                texts=tuple(tuple(str(some) for some, _ in row) for row in counts),
            )
        )
    return heat_maps_figure(
        maps,
        title="Numbers of the paper that a curve width and a noise are consistent with",
        across="full width of the curve at half maximum [deg]",
        up="peak SNR [dB]",
    )
