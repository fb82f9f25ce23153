"""Table 2 and Fig. 7: errors of the online searches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from markerseek.pictures import Line, Panel, panels_figure
from markerseek.studies.paper.look import COLOURS, MARKS, error_line
from markerseek.studies.paper.methods import BRACKET_ACQUISITIONS, BRACKETS, NAMES, TABLE_ACQUISITIONS, Name
from markerseek.studies.paper.online_runs import OnlineRun
from markerseek.studies.paper.reported import reported
from markerseek.studies.paper.section import Beside, Cell, Errors, Picture, Section, Table, beside, errors_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

METHOD = (
    (
        "The searches drive the simulated rig in virtual time, from −35°: stage with its encoder, play and approach "
        "from below, laser pulses with jitter, 16 of them averaged, frames of 128 channels with noise, beamforming. "
        "The phantom is a simulated stand-in. TS and GSS make 28 acquisitions; what shorter searches would have "
        "answered is cut from the same run, because a bracket search asks the same questions however long it will be. "
        "WA steps by 5° and ends once the peak is recorded and passed. The reference is the true angle."
    ),
)


def table2(runs: Sequence[OnlineRun]) -> Section:
    """Table 2: errors of WA with its early end, and of TS and GSS at 16 acquisitions.

    Parameters
    ----------
    runs
        Of `markerseek.studies.paper.online_runs.online_runs`.
    """
    besides: list[Beside] = []
    rows: list[tuple[Cell, ...]] = []
    for level_db in levels_of(runs):
        for name in NAMES:
            found = [run for run in runs if (run.method, run.peak_snr_db) == (name, level_db)]
            errors = errors_of(np.array([_answer_error(run) for run in found]))
            counts = errors_of(np.array([float(_answered_after(run)) for run in found]))
            rows.append(
                (
                    name,
                    level_db,
                    counts.mean_deg,
                    errors.count,
                    errors.mean_deg,
                    errors.spread_deg,
                    errors.half_deg,
                    errors.failed,
                )
            )
            condition = f"{level_db:g} dB"
            besides.append(beside(f"table2/{name}", errors, condition=condition))
            if name == "WA":
                besides.append(
                    Beside(
                        paper=reported("table2/WA/N"),
                        ours=counts.mean_deg,
                        spread=counts.spread_deg,
                        half=counts.half_deg,
                        condition=condition,
                    )
                )
    return Section(
        name="table2",
        title="Table 2: online analysis",
        method=METHOD,
        besides=tuple(besides),
        tables=(
            Table(
                name="table2",
                caption="Errors of the online searches",
                columns=(
                    "method",
                    "peak_snr_db",
                    "acquisitions",
                    "searches",
                    "mean_error_deg",
                    "spread_deg",
                    "half_interval95_deg",
                    "share_off_by_more_than_4.33_deg",
                ),
                rows=tuple(rows),
            ),
            _every_run(runs),
        ),
    )


def fig7(runs: Sequence[OnlineRun]) -> Section:
    """Fig. 7: mean error of TS and GSS over the number of acquisitions.

    Parameters
    ----------
    runs
        Of `markerseek.studies.paper.online_runs.online_runs`.
    """
    cells = {
        (level_db, name, count): errors_of(
            np.array([r.error_deg(count) for r in runs if (r.method, r.peak_snr_db) == (name, level_db)])
        )
        for level_db in levels_of(runs)
        for name in BRACKETS
        for count in BRACKET_ACQUISITIONS
    }
    return Section(
        name="fig7",
        title="Fig. 7: online analysis, mean error over the number of acquisitions",
        method=METHOD,
        besides=tuple(
            beside(f"fig7/{name}/{count}", cells[level_db, name, count], condition=f"{level_db:g} dB")
            for count in (2, 28)
            for name in BRACKETS
            for level_db in levels_of(runs)
        ),
        tables=(
            Table(
                name="fig7",
                caption="Errors of TS and GSS online",
                columns=(
                    "peak_snr_db",
                    "method",
                    "acquisitions",
                    "searches",
                    "mean_error_deg",
                    "spread_deg",
                    "half_interval95_deg",
                    "share_off_by_more_than_4.33_deg",
                ),
                rows=tuple((*key, e.count, e.mean_deg, e.spread_deg, e.half_deg, e.failed) for key, e in cells.items()),
                shown=False,
            ),
        ),
        pictures=(
            Picture(
                name="fig7",
                alt="Mean error of TS and GSS online over the number of acquisitions, one panel for each noise",
                draw=partial(_draw_errors, cells),
            ),
        ),
    )


def levels_of(runs: Sequence[OnlineRun]) -> list[float]:
    """Peak SNR of the runs in dB, each once.

    Parameters
    ----------
    runs
        Of `markerseek.studies.paper.online_runs.online_runs`.
    """
    return list(dict.fromkeys(run.peak_snr_db for run in runs))


def _answered_after(run: OnlineRun) -> int:
    """Acquisitions after which Table 2 asks: 16 of a bracket search, all that WA made."""
    return TABLE_ACQUISITIONS if run.method in BRACKETS else len(run.track_deg)


def _answer_error(run: OnlineRun) -> float:
    return run.error_deg(_answered_after(run))


def _every_run(runs: Sequence[OnlineRun]) -> Table:
    return Table(
        name="table2_searches",
        caption="Every online search",
        columns=(
            "method",
            "peak_snr_db",
            "repeat",
            "position",
            "truth_deg",
            "acquisitions",
            "answer_deg",
            "error_deg",
            "travel_of_whole_run_deg",
            "elapsed_s",
            "acquiring_s",
        ),
        rows=tuple(
            (
                run.method,
                run.peak_snr_db,
                run.repeat,
                run.position,
                run.truth_deg,
                _answered_after(run),
                run.answers_deg[_answered_after(run)],
                _answer_error(run),
                run.travel_deg,
                run.elapsed_s,
                run.acquiring_s,
            )
            for run in runs
        ),
        shown=False,
    )


def _draw_errors(cells: dict[tuple[float, Name, int], Errors]) -> Figure:
    panels = []
    for level_db in dict.fromkeys(level_db for level_db, _, _ in cells):
        lines = []
        for name in BRACKETS:
            lines.append(error_line(name, {n: e for (db, m, n), e in cells.items() if (db, m) == (level_db, name)}))
            paper = [reported(f"fig7/{name}/{count}").mean for count in (2, 28)] + [reported(f"table2/{name}").mean]
            lines.append(
                Line(
                    label=f"{name}, paper",
                    x=(2.0, 28.0, 16.0),
                    y=tuple(paper),
                    colour=COLOURS[name],
                    form="mark",
                    mark=MARKS[name],
                )
            )
        panels.append(Panel(title=f"simulated rig, {level_db:g} dB", lines=tuple(lines)))
    return panels_figure(
        panels,
        title="Online searches on the simulated rig",
        across="acquisitions N",
        up="mean error [deg]",
        columns=2,
        scale="log",
        panel_in=(5.0, 3.6),
    )
