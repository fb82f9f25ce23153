"""The map of curve widths and noises that are consistent with the paper's numbers, each alone and all at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from markerseek.pictures import HeatMap, heat_maps_figure
from markerseek.studies.paper.consistency_sweep import FAMILIES, Spot, checks, sweep
from markerseek.studies.paper.curve_runs import (
    fwhm_deg,
)
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.fig5 import FITTED
from markerseek.studies.paper.reported import reported
from markerseek.studies.paper.section import Cell, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def consistency(effort: Effort) -> Section:
    """Map of the combinations of width and noise that are consistent with the paper's numbers.

    Parameters
    ----------
    effort
        What may be used.
    """
    spots = sweep(effort)
    best = min(spots, key=lambda spot: spot.misfit)
    widths = len({spot.condition.source_radius_m for spot in spots})
    return Section(
        name="consistency",
        title="Consistency: which curve widths and noises give the paper's numbers",
        method=(
            (
                f"The published searches on intensity curves of {widths} widths under {len(spots) // widths} noises: "
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
        across="FWHM of the curve [deg]",
        up="peak SNR [dB]",
    )
