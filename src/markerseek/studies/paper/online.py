"""The online analysis (section 2.5 C): the searches drive the simulated rig, in virtual time. Table 2, Fig. 7 and 8.

Stage motion, play, pulses, noise and averaging are those of the simulated rig; each acquisition is a frame of channel
data. The probe begins at −35°, and a search ends with a move to the angle found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np

from markerseek import rigs
from markerseek.core import PAPER_RANGE, Estimate, Policy, SearchError, SearchPlan
from markerseek.pictures import panel_grid, shared_legend
from markerseek.search import build
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    ONLINE_STEPS,
    PAPER_METHODS,
    PEAK_COUNTS,
    TABLE_ACQUISITIONS,
    PaperMethod,
    RunOptions,
    policy_of,
)
from markerseek.studies.paper.offline import LEVELS_DB, grid
from markerseek.studies.paper.printed import PaperNumber, paper_number, printed_value
from markerseek.studies.paper.section import (
    COLOURS,
    ERRORS,
    MARKS,
    Answer,
    Cell,
    Comparison,
    Errors,
    Panel,
    Section,
    compared,
    errors_figure,
    errors_of,
    errors_table,
    make_section,
    make_table,
    summary_of,
)
from markerseek.studies.trial import searched

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPEATS = 4
"""Times that the nine positions are visited, each time with another grid, other spots and other noise."""

TISSUE = "plastisol-phantom"
"""The simulated material in place of the phantom of the online analysis."""

Ours: TypeAlias = Literal["posterior", "posterior, 16", "posterior, survey"]
"""The posterior in three forms; `prose.toml` says which."""

OnlineMethod: TypeAlias = PaperMethod | Ours

_ORDER: tuple[OnlineMethod, ...] = (*PAPER_METHODS, *get_args(Ours))

ENDS_BY_ITSELF: tuple[OnlineMethod, ...] = ("WA", "posterior", "posterior, survey")
"""Methods whose number of acquisitions is a result."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineRun:
    """What one search on the rig is given."""

    method: OnlineMethod
    peak_snr_db: float
    repeat: int
    """Number of the visit to the nine places, from 0."""
    position: int
    """Number of the place, from 1."""
    marker: MarkerSettings
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineSearch(OnlineRun):
    """One search on the rig."""

    truth_deg: float
    track_deg: tuple[float, ...]
    """Angles reached, one for each acquisition."""
    estimates: dict[int, Estimate]
    """Answers by number of acquisitions; of WA and ours the last only."""

    @property
    def table_acquisitions(self) -> int:
        """Acquisitions of Table 2: 16 of a bracket search, all of the others."""
        return TABLE_ACQUISITIONS if self.method in BRACKETS else len(self.track_deg)

    def answer(self, acquisitions: int) -> Answer:
        """Answer after this number of acquisitions."""
        return Answer.of(self.estimates[acquisitions], truth_deg=self.truth_deg)


def online_searches(options: RunOptions) -> list[OnlineSearch]:
    """Searches of TS and GSS (28 acquisitions), WA (5° steps, early end) and ours at the nine positions, by noise.

    With fewer markers than the paper's there are fewer repeats.
    """
    runs = []
    for repeat in range(max(1, round(REPEATS * options.share))):
        seeds = np.random.SeedSequence([options.seed, 77, repeat])
        for position, marker in enumerate(grid(np.random.Generator(np.random.PCG64(seeds))), start=1):
            # The seed depends on the place only: all methods are compared on the same random numbers.
            seed = int(seeds.generate_state(1)[0]) + position
            runs += [
                OnlineRun(method=name, peak_snr_db=level_db, repeat=repeat, position=position, marker=marker, seed=seed)
                for level_db in LEVELS_DB
                for name in _ORDER
            ]
    return options.each(search_online, runs, stage="online searches, from channel data")


def search_online(given: OnlineRun) -> OnlineSearch:
    """Run one search."""
    settings = SimulatedSettings(
        tissue=TISSUE,
        marker=given.marker,
        noise=NoiseSettings(peak_snr_db=given.peak_snr_db),
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        start_deg=PAPER_RANGE.low_deg,
    )
    rig = rigs.simulated(seed=given.seed, settings=settings)
    if rig.facts.truth_deg is None:
        raise SearchError("online: the rig has no marker, so that there is no error")
    found = searched(
        _policy(given.method),
        rig.scanner,
        stay=False,
        dark_frames=rig.dark_frames if given.method in get_args(Ours) else 0,
        counts=BRACKET_ACQUISITIONS if given.method in BRACKETS else (),
    )
    return OnlineSearch(
        **{each.name: getattr(given, each.name) for each in fields(given)},
        truth_deg=rig.facts.truth_deg,
        track_deg=tuple(sample.angle_deg for sample in found.samples),
        estimates=found.answers or {len(found.samples): found.finished.estimate},
    )


def _policy(method: OnlineMethod) -> Policy:
    start_deg = PAPER_RANGE.low_deg
    match method:
        case "TS" | "GSS":
            # With the largest N only: it contains the shorter searches.
            return policy_of(method, acquisitions=max(BRACKET_ACQUISITIONS))
        case "WA":
            return policy_of(method, acquisitions=ONLINE_STEPS, early_end=True)
        case "posterior, survey":
            return build(SearchPlan(method="posterior", start_deg=start_deg))
    return policy_of("posterior", acquisitions=TABLE_ACQUISITIONS, start_deg=start_deg, early_end=method == "posterior")


def table2(searches: Sequence[OnlineSearch]) -> Section:
    """Table 2: errors of WA with its early end, and of TS and GSS after 16 acquisitions."""
    comparisons: list[Comparison] = []
    rows: list[tuple[Cell, ...]] = []
    for level_db in LEVELS_DB:
        for name in _ORDER:
            found = [search for search in searches if (search.method, search.peak_snr_db) == (name, level_db)]
            errors = summary_of(search.answer(search.table_acquisitions) for search in found)
            counts = errors_of(float(search.table_acquisitions) for search in found)
            rows.append((name, level_db, counts.mean_deg, *errors))
            ours, condition = f"{name} (ours) online", f"{level_db:g} dB"
            is_ours = name in get_args(Ours)
            number = PaperNumber(quantity=f"{ours}, mean error") if is_ours else f"table2/{name}"
            comparisons.append(compared(number, errors, condition=condition))
            if name in ENDS_BY_ITSELF:
                ended = PaperNumber(quantity=f"{ours}, acquisitions until it ended", unit="acquisitions")
                comparisons.append(
                    Comparison(
                        paper=ended if is_ours else paper_number(f"table2/{name}/N"),
                        ours=counts.mean_deg,
                        sd=counts.sd_deg,
                        half=counts.half_deg,
                        condition=condition,
                    )
                )
    return make_section(
        "table2",
        method=("online",),
        comparisons=tuple(comparisons),
        tables=(
            make_table("table2", "Errors of the online searches", f"method peak_snr_db acquisitions {ERRORS}", rows),
        ),
    )


_ByGroup: TypeAlias = dict[tuple[float, PaperMethod, int], Errors]
"""Errors by peak SNR, method and number of acquisitions."""


def fig7(searches: Sequence[OnlineSearch]) -> Section:
    """Fig. 7: mean error of TS and GSS over the number of acquisitions."""
    errors: _ByGroup = {
        (level_db, name, count): summary_of(
            each.answer(count) for each in searches if (each.method, each.peak_snr_db) == (name, level_db)
        )
        for level_db in LEVELS_DB
        for name in BRACKETS
        for count in BRACKET_ACQUISITIONS
    }
    return make_section(
        "fig7",
        method=("online",),
        comparisons=tuple(
            compared(f"fig7/{name}/{count}", errors[level_db, name, count], condition=f"{level_db:g} dB")
            for count in (2, 28)
            for name in BRACKETS
            for level_db in LEVELS_DB
        ),
        tables=(errors_table("fig7", "Errors of TS and GSS online", "peak_snr_db method acquisitions", errors),),
        draw=partial(_draw_errors, errors),
    )


def _draw_errors(errors: _ByGroup) -> Figure:
    printed_deg = {
        (name, count): printed_value(key)
        for name in BRACKETS
        for count, key in ((2, f"fig7/{name}/2"), (TABLE_ACQUISITIONS, f"table2/{name}"), (28, f"fig7/{name}/28"))
    }
    return errors_figure(
        [
            Panel(
                f"simulated rig, {level_db:g} dB",
                {group[1:]: each for group, each in errors.items() if group[0] == level_db},
                printed_deg,
            )
            for level_db in LEVELS_DB
        ],
        heading="Online searches on the simulated rig",
        columns=2,
        panel_in=(5.0, 3.6),
    )


def fig8(searches: Sequence[OnlineSearch]) -> Section:
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
        level=level_db,
    )


def _draw_tracks(searches: Sequence[OnlineSearch]) -> Figure:
    truths_deg = {each.position: each.truth_deg for each in searches}
    tracks_deg = {(each.position, each.method): each.track_deg for each in searches}
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
        for name in BRACKETS:
            track_deg = tracks_deg[position, name]
            axes.plot(
                range(1, len(track_deg) + 1),
                track_deg,
                label=name,
                color=COLOURS[name],
                marker=MARKS[name],
                markersize=3.5,
                linewidth=1.2,
            )
    shared_legend(figure)
    return figure
