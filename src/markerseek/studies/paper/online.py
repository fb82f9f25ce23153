"""The online analysis (section 2.5 C): the searches drive the simulated rig, in virtual time. Table 2, Fig. 7 and 8.

Stage motion, backlash, pulses, noise and averaging are those of the simulated rig; each acquisition is a frame of
channel data. The probe begins at −35°, and a search ends with a move to the angle found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from markerseek import rigs
from markerseek.core import PAPER_RANGE
from markerseek.show import panel_grid, shared_legend
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    BUILT,
    ONLINE_STEPS,
    PEAK_COUNTS,
    TABLE_ACQUISITIONS,
    PaperMethod,
    PaperSearch,
    RunOptions,
    paper_search,
    policy_of,
)
from markerseek.studies.paper.offline import LEVELS_DB, grid
from markerseek.studies.paper.section import (
    ERROR_COLUMNS,
    STYLES,
    Comparison,
    Errors,
    Group,
    Panel,
    Section,
    TableCell,
    compared,
    errors_by_group,
    errors_figure,
    errors_of,
    errors_table,
    make_section,
    make_table,
    paper_number,
    printed_value,
)
from markerseek.studies.summary import Mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPEATS = 4
"""Times that the nine positions are visited, each time with another grid, other spots and other noise."""

TISSUE = "plastisol-phantom"
"""The simulated material in place of the phantom of the online analysis."""


class OnlineRun(NamedTuple):
    """What one search on the rig is given."""

    method: PaperMethod
    peak_snr_db: float
    repeat: int
    position: int
    marker: MarkerSettings
    seed: int


def online_searches(options: RunOptions) -> list[PaperSearch]:
    """Return the searches of TS and GSS (28 acquisitions), WA (5° steps, early end) at nine positions, by noise.

    With fewer markers than the paper's there are fewer repeats.
    """
    runs = []
    for repeat in range(max(1, round(REPEATS * options.share))):
        seeds = np.random.SeedSequence([options.seed, 77, repeat])
        for position, marker in enumerate(grid(np.random.Generator(np.random.PCG64(seeds))), start=1):
            # The seed depends on the place only: all methods are compared on the same random numbers.
            seed = int(seeds.generate_state(1)[0]) + position
            runs += [
                OnlineRun(name, level_db, repeat, position, marker, seed) for level_db in LEVELS_DB for name in BUILT
            ]
    return options.each(search_online, runs, stage="online searches, from channel data")


def search_online(given: OnlineRun) -> PaperSearch:
    """Run one search."""
    settings = SimulatedSettings(
        tissue=TISSUE,
        marker=given.marker,
        noise=NoiseSettings(peak_snr_db=given.peak_snr_db),
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        start_deg=PAPER_RANGE.low_deg,
    )
    rig = rigs.simulated(seed=given.seed, settings=settings)
    return paper_search(
        # With the largest N only of TS and GSS: it contains the shorter searches.
        policy_of(given.method, acquisitions=ONLINE_STEPS if given.method == "WA" else 28, early_end=True),
        rig,
        truth_deg=rig.facts.truth_deg or 0.0,
        counts=BRACKET_ACQUISITIONS if given.method in BRACKETS else (),
        stay=False,
        place=TISSUE,
        peak_snr_db=given.peak_snr_db,
        method=given.method,
        position=given.position,
        repeat=given.repeat,
    )


def table2(searches: Sequence[PaperSearch]) -> Section:
    """Return Table 2: errors of WA with its early end, and of TS and GSS after 16 acquisitions."""
    comparisons: list[Comparison] = []
    rows: list[tuple[TableCell, ...]] = []
    for level_db in LEVELS_DB:
        condition = f"{level_db:g} dB"
        for name in BUILT:
            found = [each for each in searches if (each.method, each.peak_snr_db) == (name, level_db)]
            counts = [TABLE_ACQUISITIONS if name in BRACKETS else max(each.answers_deg) for each in found]
            errors = errors_of([each.error_deg(count) for each, count in zip(found, counts, strict=True)])
            made = Mean.of(counts)
            rows.append((name, level_db, made.mean, *errors.cells))
            comparisons.append(compared(f"table2/{name}", errors, condition=condition))
            if name == "WA":
                number = paper_number("table2/WA/N")
                ended = Comparison(paper=number, ours=made.mean or 0.0, sd=made.sd, half=made.half, condition=condition)
                comparisons.append(ended)
    columns = f"method peak_snr_db acquisitions {ERROR_COLUMNS}"
    return make_section(
        "table2",
        method=("online",),
        comparisons=tuple(comparisons),
        tables=(make_table("table2", "Errors of the online searches", columns, rows),),
    )


def fig7(searches: Sequence[PaperSearch]) -> Section:
    """Fig. 7: mean error of TS and GSS over the number of acquisitions."""
    errors = errors_by_group(each for each in searches if each.method in BRACKETS)
    return make_section(
        "fig7",
        method=("online",),
        comparisons=tuple(
            compared(f"fig7/{name}/{count}", errors[TISSUE, level_db, name, count], condition=f"{level_db:g} dB")
            for count in (2, 28)
            for name in BRACKETS
            for level_db in LEVELS_DB
        ),
        tables=(errors_table("fig7", "Errors of TS and GSS online", "material", errors),),
        draw=partial(_draw_errors, errors),
    )


def _draw_errors(errors: Mapping[Group, Errors]) -> Figure:
    printed_deg: dict[tuple[PaperMethod, int], float] = {
        (name, count): printed_value(key)
        for name in BRACKETS
        for count, key in ((2, f"fig7/{name}/2"), (TABLE_ACQUISITIONS, f"table2/{name}"), (28, f"fig7/{name}/28"))
    }
    return errors_figure(
        errors,
        [Panel(TISSUE, level_db, f"simulated rig, {level_db:g} dB", printed_deg) for level_db in LEVELS_DB],
        heading="Online searches on the simulated rig",
        columns=2,
        panel_in=(5.0, 3.6),
    )


def fig8(searches: Sequence[PaperSearch]) -> Section:
    """Fig. 8: angle of the probe at each acquisition of TS and GSS, one panel for each position."""
    # The lowest noise: the tracks then show the rule of the method, not chance.
    level_db = max(LEVELS_DB)
    first = [each for each in searches if each.repeat == 0 and each.method in BRACKETS and each.peak_snr_db == level_db]
    rows = (
        (search.position, search.method, number, angle_deg, search.truth_deg)
        for search in first
        for number, angle_deg in enumerate(search.track_deg, start=1)
    )
    columns = "position method acquisition angle_deg truth_deg"
    return make_section(
        "fig8",
        method=("online",),
        tables=(make_table("fig8", "Angles reached", columns, rows, shown=False),),
        draw=partial(_draw_tracks, first),
        results={"level": level_db},
    )


def _draw_tracks(searches: Sequence[PaperSearch]) -> Figure:
    truths_deg = {each.position: each.truth_deg for each in searches}
    figure, panels = panel_grid(
        [f"position {at}, marker at {truth_deg:z.1f}°".replace("-", "−") for at, truth_deg in truths_deg.items()],
        heading="Track of the probe on the simulated rig",
        x_label="acquisition",
        y_label="probe angle [deg]",
        columns=3,
        panel_in=(3.7, 3.0),
    )
    for axes, (position, truth_deg) in zip(panels, truths_deg.items(), strict=True):
        axes.axhline(truth_deg, color="#e08a1e", linestyle="--", linewidth=1.2, label="marker (truth)")
        for each in searches:
            if each.position == position:
                axes.plot(
                    range(1, len(each.track_deg) + 1),
                    each.track_deg,
                    label=each.method,
                    markersize=3.5,
                    linewidth=1.2,
                    **STYLES[each.method],
                )
    shared_legend(figure)
    return figure
