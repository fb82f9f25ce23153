"""Fig. 8: the track of the probe in the online searches, one panel for each position."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from markerseek.pictures import Line, Panel, panels_figure
from markerseek.studies.paper.look import COLOURS, MARKS
from markerseek.studies.paper.methods import BRACKETS
from markerseek.studies.paper.online import METHOD, levels_of
from markerseek.studies.paper.online_runs import OnlineRun
from markerseek.studies.paper.section import Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def fig8(runs: Sequence[OnlineRun]) -> Section:
    """Fig. 8: where the probe stood at each acquisition of TS and GSS, one panel for each position.

    Parameters
    ----------
    runs
        Of `markerseek.studies.paper.online_runs.online_runs`.
    """
    quietest = max(levels_of(runs))
    shown = [run for run in runs if run.repeat == 0 and run.method in BRACKETS and run.peak_snr_db == quietest]
    return Section(
        name="fig8",
        title="Fig. 8: track of the probe, positions 1 to 9",
        method=(*METHOD, f"Shown is the first visit to each position, at a peak SNR of {quietest:g} dB."),
        tables=(
            Table(
                name="fig8",
                caption="Angles reached",
                columns=("position", "method", "acquisition", "angle_deg", "truth_deg"),
                rows=tuple(
                    (run.position, run.method, number, angle_deg, run.truth_deg)
                    for run in shown
                    for number, angle_deg in enumerate(run.track_deg, start=1)
                ),
                shown=False,
            ),
        ),
        pictures=(
            Picture(
                name="fig8",
                alt="Probe angle over the acquisitions of TS and GSS beside the marker's angle, nine panels",
                draw=partial(_draw_tracks, shown),
            ),
        ),
        remarks=(
            (
                "The paper prints this figure without numbers. How it counts its positions within the grid it does not "
                "say; ours go row by row along x."
            ),
        ),
    )


def _draw_tracks(shown: Sequence[OnlineRun]) -> Figure:
    panels = []
    for position in sorted({run.position for run in shown}):
        here = [run for run in shown if run.position == position]
        lines = [Line(label="marker (truth)", x=(0.0,), y=(here[0].truth_deg,), colour="#e08a1e", form="level")]
        lines += [
            Line(
                label=run.method,
                x=tuple(float(n) for n in range(1, len(run.track_deg) + 1)),
                y=run.track_deg,
                colour=COLOURS[run.method],
                mark=MARKS[run.method],
            )
            for run in here
        ]
        panels.append(Panel(title=f"position {position}, marker at {here[0].truth_deg:.1f}°", lines=tuple(lines)))
    return panels_figure(
        panels, title="Track of the probe on the simulated rig", across="acquisition", up="probe angle [deg]"
    )
