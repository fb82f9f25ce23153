"""Fig. 7 and Fig. 8: errors of the online searches over the number of acquisitions, and tracks of the probe."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from markerseek.pictures import panel_grid, shared_legend
from markerseek.studies.paper.methods import BRACKET_ACQUISITIONS, BRACKETS, TABLE_ACQUISITIONS, PaperMethod
from markerseek.studies.paper.online import METHOD, OnlineSearch, levels_of
from markerseek.studies.paper.printed import paper_number
from markerseek.studies.paper.section import Errors, Section, Table, compared, summary_of
from markerseek.studies.paper.style import COLOURS, MARKS, Panel, errors_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_ByGroup: TypeAlias = dict[tuple[float, PaperMethod, int], Errors]
"""Errors by peak SNR, method and number of acquisitions."""


def fig7(searches: Sequence[OnlineSearch]) -> Section:
    """Fig. 7: mean error of TS and GSS over the number of acquisitions."""
    errors: _ByGroup = {
        (level_db, name, count): summary_of(
            each.answer(count) for each in searches if (each.method, each.peak_snr_db) == (name, level_db)
        )
        for level_db in levels_of(searches)
        for name in BRACKETS
        for count in BRACKET_ACQUISITIONS
    }
    return Section(
        name="fig7",
        title="Fig. 7: online analysis, mean error over the number of acquisitions",
        method=METHOD,
        comparisons=tuple(
            compared(f"fig7/{name}/{count}", errors[level_db, name, count], condition=f"{level_db:g} dB")
            for count in (2, 28)
            for name in BRACKETS
            for level_db in levels_of(searches)
        ),
        tables=(
            Table(
                name="fig7",
                caption="Errors of TS and GSS online",
                rows=tuple(
                    {"peak_snr_db": level_db, "method": name, "acquisitions": count, **each.cells}
                    for (level_db, name, count), each in errors.items()
                ),
                shown=False,
            ),
        ),
        draw=partial(_draw_errors, errors),
        alt="Mean error of TS and GSS online over the number of acquisitions, one panel for each noise",
    )


def _draw_errors(errors: _ByGroup) -> Figure:
    printed_deg = {
        (name, count): paper_number(key).value
        for name in BRACKETS
        for count, key in ((2, f"fig7/{name}/2"), (TABLE_ACQUISITIONS, f"table2/{name}"), (28, f"fig7/{name}/28"))
    }
    return errors_figure(
        [
            Panel(
                title=f"simulated rig, {level_db:g} dB",
                errors={group[1:]: each for group, each in errors.items() if group[0] == level_db},
                printed_deg=printed_deg,
            )
            for level_db in dict.fromkeys(level_db for level_db, _, _ in errors)
        ],
        heading="Online searches on the simulated rig",
        columns=2,
        panel_in=(5.0, 3.6),
    )


def fig8(searches: Sequence[OnlineSearch]) -> Section:
    """Fig. 8: angle of the probe at each acquisition of TS and GSS, one panel for each position."""
    # The lowest noise: the tracks then show the rule of the method, not chance.
    level_db = max(levels_of(searches))
    first = [each for each in searches if each.repeat == 0 and each.method in BRACKETS and each.peak_snr_db == level_db]
    return Section(
        name="fig8",
        title="Fig. 8: track of the probe, positions 1 to 9",
        method=(*METHOD, f"Shown is the first visit to each position, at a peak SNR of {level_db:g} dB."),
        tables=(
            Table(
                name="fig8",
                caption="Angles reached",
                rows=tuple(
                    {
                        "position": search.position,
                        "method": search.method,
                        "acquisition": number,
                        "angle_deg": angle_deg,
                        "truth_deg": search.truth_deg,
                    }
                    for search in first
                    for number, angle_deg in enumerate(search.track_deg, start=1)
                ),
                shown=False,
            ),
        ),
        draw=partial(_draw_tracks, first),
        alt="Probe angle over the acquisitions of TS and GSS beside the marker's angle, nine panels",
        remarks=(
            (
                "The paper prints this figure without numbers. It does not say how it counts the positions of the "
                "grid; ours are counted row by row along x."
            ),
        ),
    )


def _draw_tracks(searches: Sequence[OnlineSearch]) -> Figure:
    truths_deg = {each.position: each.truth_deg for each in searches}
    tracks_deg = {(each.position, each.method): each.track_deg for each in searches}
    figure, panels = panel_grid(
        [f"position {position}, marker at {truth_deg:.1f}°" for position, truth_deg in truths_deg.items()],
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
