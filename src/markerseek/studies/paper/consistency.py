"""Which curve widths and noises are consistent with the paper's numbers, each alone and all at once, as a map.

A number of the paper is consistent with a combination if, as rounded, it lies within the central 95 % of the means of
resampled searches of ours, as many as the paper made (bootstrap).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from markerseek.core import Float64
from markerseek.pictures import new_figure
from markerseek.studies.paper.banks import grid
from markerseek.studies.paper.curve_runs import Condition, answers_of_trial, study_of
from markerseek.studies.paper.fig5 import FITTED
from markerseek.studies.paper.methods import ONLINE_STEPS, PAPER_METHODS, TABLE_ACQUISITIONS, PaperMethod
from markerseek.studies.paper.options import PAPER_MARKERS, RunOptions
from markerseek.studies.paper.printed import MATERIALS, paper_number
from markerseek.studies.paper.section import Cell, Section, make_section, make_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RADII_M = (0.15e-3, 0.3e-3, 0.35e-3, 0.4e-3, 0.45e-3, 0.5e-3, 0.8e-3, 1.2e-3)
"""Radii of the absorber, which set the widths: from the default to half the stained patch of 5 mm at its waist."""

LEVELS_DB = (20.0, 30.0, 40.0, 50.0, 60.0, 80.0)
"""Peak SNR."""

SWEEPS = (8, 12, 16, 22, 28)
"""N of WA over which its mean error is averaged here; Fig. 5 has all from 8 to 28."""

RESAMPLES = 400
"""Resamples of the bootstrap."""

FAMILIES = ("simulation", "offline", "online", None)
"""Kinds of the paper's numbers; None: all of them."""


class Check(NamedTuple):
    """One number of the paper in the map, and the searches behind it: family, method, and acquisitions."""

    key: str
    family: str
    method: PaperMethod
    acquisitions: tuple[int, ...]


CHECKS = (
    Check("fig5/WA", "simulation", "WA", SWEEPS),
    Check("fig5/TS", "simulation", "TS", (28,)),
    Check("fig5/GSS", "simulation", "GSS", (28,)),
    *(
        Check(f"table1/{name}/{material}", "offline", name, (TABLE_ACQUISITIONS,))
        for material in MATERIALS[:-1]
        for name in PAPER_METHODS
    ),
    Check("table2/WA", "online", "WA", (ONLINE_STEPS,)),
    Check("table2/TS", "online", "TS", (TABLE_ACQUISITIONS,)),
    Check("fig7/TS/28", "online", "TS", (28,)),
    Check("table2/GSS", "online", "GSS", (TABLE_ACQUISITIONS,)),
    Check("fig7/GSS/28", "online", "GSS", (28,)),
)
"""Numbers that each combination is compared with: mean errors, without those of single searches and without counts.
Their order is that of the random numbers of the resamples."""

FIG5 = tuple(check.key for check in CHECKS if check.family == "simulation")


class Combination(NamedTuple):
    """One combination of width and noise: for each number our mean error in degrees, and whether it is consistent."""

    condition: Condition
    ours: dict[str, float]
    consistent: dict[str, bool]

    def share(self, family: str | None) -> tuple[int, int]:
        """Numbers of a family that are consistent, and how many there are; None: of all."""
        found = [self.consistent[check.key] for check in CHECKS if family in (None, check.family)]
        return sum(found), len(found)

    @property
    def misfit(self) -> float:
        """Sum of the squared logarithms of ours over the paper's, for the three numbers of Fig. 5."""
        # An error may be 0 with little noise, and has no logarithm then.
        logs = (math.log(max(self.ours[key], 1e-6) / paper_number(key).value) for key in FIG5)
        return sum(log**2 for log in logs)


def _combinations(
    source_radius_m: float, *, levels_db: Sequence[float], trials: int, repeats: int, seed: int
) -> list[Combination]:
    """One width under every noise."""
    rng = np.random.Generator(np.random.PCG64([seed, 8]))
    # The same positions under every noise, so that only the noise differs.
    positions_deg = [marker.angle_deg for _ in range(repeats) for marker in grid(rng)]
    combinations = []
    for level_db in levels_db:
        condition = Condition(source_radius_m=source_radius_m, peak_snr_db=level_db)
        study = study_of(condition, seed=seed, trials=trials, sweeps=SWEEPS)
        random = [answers_of_trial((study, trial)) for trial in range(trials)]
        offline = partial(study_of, condition, seed=seed, trials=1, sweeps=(TABLE_ACQUISITIONS,), early=True)
        at_positions = [answers_of_trial((offline(marker_deg=marker_deg), 0)) for marker_deg in positions_deg]
        ours, consistent = {}, {}
        for key, family, method, counts in CHECKS:
            # The number of WA in Fig. 5 is a mean over N; all others have one N.
            found = random if family == "simulation" else at_positions
            errors = np.array([np.mean([each[method, count].error_deg for count in counts]) for each in found])
            ours[key] = float(errors.mean())
            # The paper's searches: random markers in the simulation, nine positions otherwise.
            searches = PAPER_MARKERS if family == "simulation" else 9
            consistent[key] = is_consistent(paper_number(key).value, errors, searches=searches, rng=rng)
        combinations.append(Combination(condition, ours, consistent))
    return combinations


def is_consistent(
    paper: float, errors: Float64[np.ndarray, " searches"], *, searches: int, rng: np.random.Generator
) -> bool:
    """Whether the paper's mean of n searches, rounded to two decimal places, is consistent with these errors.

    ``paper``: the paper's mean in degrees. ``errors``: errors of our searches in degrees. ``searches``: number n of
    searches that the paper made.
    """
    # Both means have a sampling error. Resamples of 1/(1/n + 1/m) searches have the variance of their difference.
    count = max(1, round(1 / (1 / searches + 1 / errors.size)))
    # Resampled, because the errors are far from normal: a few large ones make up most of the mean.
    means = rng.choice(errors, (RESAMPLES, count)).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    # 0.005 deg is half of the last printed digit.
    return bool(low - 0.005 <= paper <= high + 0.005)


def consistency(options: RunOptions) -> Section:
    """Map of the combinations of width and noise that are consistent with the paper's numbers."""
    whole = options.share > 0.2
    of_width = partial(
        _combinations,
        levels_db=LEVELS_DB if whole else LEVELS_DB[::2],
        trials=max(10, round(60 * options.share)),
        repeats=max(1, round(3 * options.share)),
        seed=options.seed,
    )
    # A job for each width, whose curve is computed once and cached in the process for all noises.
    parts = options.each(of_width, RADII_M if whole else RADII_M[::3], stage="consistency, curves")
    combinations = [combination for part in parts for combination in part]
    nearest = min(combinations, key=lambda each: each.misfit)
    places = {each.condition: (each.condition.fwhm_deg, each.condition.peak_snr_db) for each in combinations}
    by_family: list[tuple[Cell, ...]] = []
    for each in combinations:
        shares: list[Cell] = ["{} of {}".format(*each.share(family)) for family in FAMILIES]
        by_family.append((1e3 * each.condition.source_radius_m, *places[each.condition], *shares, each.misfit))
    by_number = (
        (*places[each.condition], key, paper_number(key).value, ours, "yes" if each.consistent[key] else "no")
        for each in combinations
        for key, ours in each.ours.items()
    )
    columns = "source_radius_mm fwhm_deg peak_snr_db simulation offline online all misfit_of_fig5"
    numbers = "fwhm_deg peak_snr_db number paper_deg ours_deg consistent"
    return make_section(
        "consistency",
        tables=(
            make_table("consistency", "Numbers that are consistent, by family", columns, by_family, shown=False),
            make_table("consistency_numbers", "Every number in every combination", numbers, by_number, shown=False),
        ),
        draw=partial(_draw, combinations),
        remarks=tuple(_most(combinations, family) for family in FAMILIES),
        widths=len(parts),
        noises=len(parts[0]),
        nearest=nearest.condition.words,
        numbers=", ".join(
            f"{key.removeprefix('fig5/')} {nearest.ours[key]:.3f}° for {paper_number(key).value:g}°" for key in FIG5
        ),
        drawn="it"
        if nearest.condition == FITTED
        else f"{FITTED.words}, the nearest with the usual seed and number of markers",
    )


def _most(combinations: Sequence[Combination], family: str | None) -> str:
    """Where most of the numbers of a family are consistent, in words."""
    most, every = max(each.share(family) for each in combinations)
    where = [each.condition.words for each in combinations if each.share(family)[0] == most]
    what = f"the {family} numbers" if family is not None else "all of the paper's numbers at once"
    if most < every:
        return f"No combination is consistent with {what}; the most is {most} of {every}, at {'; '.join(where[:3])}."
    shown = "; ".join(where[:6]) + ("; and more" if len(where) > 6 else "")
    return f"Consistent with {what}: {len(where)} of {len(combinations)} combinations ({shown})."


def _draw(combinations: Sequence[Combination]) -> Figure:
    """One map for each family, and one for all numbers: the count in each cell, its share as the colour."""
    widths = list(dict.fromkeys(each.condition.fwhm_deg for each in combinations))
    levels = list(dict.fromkeys(each.condition.peak_snr_db for each in combinations))
    cells = {(each.condition.fwhm_deg, each.condition.peak_snr_db): each for each in combinations}
    wide_in, high_in = 0.62 * len(widths) + 1.2, 0.42 * len(levels) + 1.0
    figure = new_figure(
        width_in=2 * wide_in,
        height_in=2 * high_in + 0.5,
        heading="Numbers of the paper that a curve width and a noise are consistent with",
    )
    for axes, family in zip(figure.subplots(2, 2).flat, FAMILIES, strict=True):
        counts = np.array([[cells[width, level].share(family)[0] for width in widths] for level in levels])
        every = combinations[0].share(family)[1]
        axes.imshow(counts / every, origin="lower", cmap="Blues", vmin=0, vmax=1, aspect="auto")
        axes.set_title(f"{family or 'all'}: numbers consistent, of {every}", fontsize=10)
        axes.set_xticks(range(len(widths)), [f"{width:.1f}" for width in widths])
        axes.set_yticks(range(len(levels)), [f"{level:g}" for level in levels])
        axes.set_xlabel("FWHM of the curve [deg]")
        axes.set_ylabel("peak SNR [dB]")
        for (row, column), count in np.ndenumerate(counts):
            colour = "white" if count / every > 0.6 else "#1c2026"
            axes.text(column, row, str(count), ha="center", va="center", fontsize=8, color=colour)
    return figure
