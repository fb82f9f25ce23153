"""The online analysis (section 2.5 C): Table 2, Fig. 7 and Fig. 8. The searches drive the rig, in virtual time.

Stage motion, play, pulses, noise and averaging are those of the simulated rig; each acquisition is a frame of channel
data. The probe begins at −35°, and a search ends with a move to the angle found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek import rigs
from markerseek.core import SearchError
from markerseek.pictures import panel_grid, shared_legend
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.banks import LEVELS_DB, PEAK_COUNTS, grid
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    ONLINE_STEPS,
    PAPER_METHODS,
    TABLE_ACQUISITIONS,
    PaperMethod,
    published,
    searched,
    shorter,
)
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import paper_number
from markerseek.studies.paper.section import (
    ERROR_COLUMNS,
    Cell,
    Comparison,
    Errors,
    Picture,
    Section,
    Table,
    compared,
    errors_of,
)
from markerseek.studies.paper.style import COLOURS, MARKS, draw_errors, draw_paper

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REPEATS = 4
"""Times that the nine positions are visited, each time with another grid, other spots and other noise."""

TISSUE = "plastisol-phantom"
"""The simulated stand-in for the phantom of the online analysis."""

_METHOD = (
    (
        "The searches drive the simulated rig in virtual time, from −35°: stage with its encoder, play and approach "
        "from below, laser pulses with jitter, 16 of them averaged, frames of 128 channels with noise, beamforming. "
        "The phantom is a simulated stand-in. TS and GSS make 28 acquisitions; the answers of shorter searches are "
        "those of the same run, because the angles of a bracket search do not depend on its length. WA steps by 5° and "
        "ends once the peak is recorded and passed. The reference is the true angle."
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class OnlineSearch:
    """One search on the rig.

    Attributes
    ----------
    method, peak_snr_db, repeat, position
        Method, noise and place: the position is counted from 1, the repeat from 0.
    truth_deg
        Angle of the marker in degrees.
    track_deg
        Angles reached, one for each acquisition, in degrees.
    answers_deg
        Answers by number of acquisitions, in degrees; of WA the last only.
    travel_deg
        Rotation from −35° to the angle found, in degrees.
    elapsed_s, acquiring_s
        Virtual time from the first move to the end, and the part of it that acquisitions took, in seconds.
    """

    method: PaperMethod
    peak_snr_db: float
    repeat: int
    position: int
    truth_deg: float
    track_deg: tuple[float, ...]
    answers_deg: dict[int, float]
    travel_deg: float
    elapsed_s: float
    acquiring_s: float

    @property
    def table_acquisitions(self) -> int:
        """Acquisitions of Table 2: 16 of a bracket search, all of WA."""
        return TABLE_ACQUISITIONS if self.method in BRACKETS else len(self.track_deg)

    def error_deg(self, acquisitions: int) -> float:
        """Absolute error of the answer after so many acquisitions, in degrees."""
        return abs(self.answers_deg[acquisitions] - self.truth_deg)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Job:
    method: PaperMethod
    peak_snr_db: float
    repeat: int
    position: int
    marker: MarkerSettings
    seed: int


def online_searches(options: RunOptions) -> list[OnlineSearch]:
    """Searches of TS, GSS (28 acquisitions) and WA (5° steps, early end) at the nine positions under each noise.

    The markers are the same for all methods and noises. With fewer markers than the paper's there are fewer repeats.

    Parameters
    ----------
    options
        What may be used.
    """
    jobs = []
    for repeat in range(max(1, round(REPEATS * options.share))):
        seeds = np.random.SeedSequence([options.seed, 77, repeat])
        for position, marker in enumerate(grid(np.random.Generator(np.random.PCG64(seeds))), start=1):
            seed = int(seeds.generate_state(1)[0]) + position
            jobs += [
                _Job(method=name, peak_snr_db=level_db, repeat=repeat, position=position, marker=marker, seed=seed)
                for level_db in LEVELS_DB
                for name in PAPER_METHODS
            ]
    return options.each(_search, jobs, stage="online searches, from channel data")


def _search(job: _Job) -> OnlineSearch:
    settings = SimulatedSettings(
        tissue=TISSUE,
        marker=job.marker,
        noise=NoiseSettings(peak_snr_db=job.peak_snr_db),
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        start_deg=-35.0,
    )
    rig = rigs.simulated(seed=job.seed, settings=settings)
    if rig.truth_deg is None:
        raise SearchError("online: the rig has no marker, so that there is no error")
    bracket = job.method in BRACKETS
    policy = published(
        job.method, acquisitions=max(BRACKET_ACQUISITIONS) if bracket else ONLINE_STEPS, early_end=not bracket
    )
    samples, finished = searched(policy, rig.scanner, stay=False)
    last = {len(samples): finished.estimate.mean_deg}
    each_s = settings.receiver.readout_s + settings.laser.pulses / settings.laser.rate_hz
    return OnlineSearch(
        method=job.method,
        peak_snr_db=job.peak_snr_db,
        repeat=job.repeat,
        position=job.position,
        truth_deg=rig.truth_deg,
        track_deg=tuple(sample.angle_deg for sample in samples),
        answers_deg=dict(shorter(job.method, samples)) if bracket else last,
        travel_deg=finished.travel_deg,
        elapsed_s=finished.elapsed_s,
        # The confirmation at the end is one more acquisition.
        acquiring_s=each_s * (len(samples) + 1),
    )


def _levels(searches: Sequence[OnlineSearch]) -> list[float]:
    return list(dict.fromkeys(search.peak_snr_db for search in searches))


def table2(searches: Sequence[OnlineSearch]) -> Section:
    """Table 2: errors of WA with its early end, and of TS and GSS after 16 acquisitions.

    Parameters
    ----------
    searches
        Of `online_searches`.
    """
    comparisons: list[Comparison] = []
    rows: list[tuple[Cell, ...]] = []
    for level_db in _levels(searches):
        for name in PAPER_METHODS:
            found = [search for search in searches if (search.method, search.peak_snr_db) == (name, level_db)]
            errors = errors_of(search.error_deg(search.table_acquisitions) for search in found)
            counts = errors_of(float(search.table_acquisitions) for search in found)
            rows.append((name, level_db, counts.mean_deg, *errors.cells))
            condition = f"{level_db:g} dB"
            comparisons.append(compared(f"table2/{name}", errors, condition=condition))
            if name == "WA":
                comparisons.append(
                    Comparison(
                        paper=paper_number("table2/WA/N"),
                        ours=counts.mean_deg,
                        sd=counts.sd_deg,
                        half=counts.half_deg,
                        condition=condition,
                    )
                )
    return Section(
        name="table2",
        title="Table 2: online analysis",
        method=_METHOD,
        comparisons=tuple(comparisons),
        tables=(
            Table(
                name="table2",
                caption="Errors of the online searches",
                columns=("method", "peak_snr_db", "acquisitions", *ERROR_COLUMNS),
                rows=tuple(rows),
            ),
            _every_search(searches),
        ),
    )


def _every_search(searches: Sequence[OnlineSearch]) -> Table:
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
                each.method,
                each.peak_snr_db,
                each.repeat,
                each.position,
                each.truth_deg,
                each.table_acquisitions,
                each.answers_deg[each.table_acquisitions],
                each.error_deg(each.table_acquisitions),
                each.travel_deg,
                each.elapsed_s,
                each.acquiring_s,
            )
            for each in searches
        ),
        shown=False,
    )


_ByGroup: TypeAlias = dict[tuple[float, PaperMethod, int], Errors]
"""Errors by peak SNR, method and number of acquisitions."""


def fig7(searches: Sequence[OnlineSearch]) -> Section:
    """Fig. 7: mean error of TS and GSS over the number of acquisitions.

    Parameters
    ----------
    searches
        Of `online_searches`.
    """
    errors: _ByGroup = {
        (level_db, name, count): errors_of(
            each.error_deg(count) for each in searches if (each.method, each.peak_snr_db) == (name, level_db)
        )
        for level_db in _levels(searches)
        for name in BRACKETS
        for count in BRACKET_ACQUISITIONS
    }
    return Section(
        name="fig7",
        title="Fig. 7: online analysis, mean error over the number of acquisitions",
        method=_METHOD,
        comparisons=tuple(
            compared(f"fig7/{name}/{count}", errors[level_db, name, count], condition=f"{level_db:g} dB")
            for count in (2, 28)
            for name in BRACKETS
            for level_db in _levels(searches)
        ),
        tables=(
            Table(
                name="fig7",
                caption="Errors of TS and GSS online",
                columns=("peak_snr_db", "method", "acquisitions", *ERROR_COLUMNS),
                rows=tuple((*group, *each.cells) for group, each in errors.items()),
                shown=False,
            ),
        ),
        pictures=(
            Picture(
                name="fig7",
                alt="Mean error of TS and GSS online over the number of acquisitions, one panel for each noise",
                draw=partial(_draw_errors, errors),
            ),
        ),
    )


def _draw_errors(errors: _ByGroup) -> Figure:
    levels_db = list(dict.fromkeys(level_db for level_db, _, _ in errors))
    figure, panels = panel_grid(
        [f"simulated rig, {level_db:g} dB" for level_db in levels_db],
        heading="Online searches on the simulated rig",
        x_label="acquisitions N",
        y_label="mean error [deg]",
        columns=2,
        panel_in=(5.0, 3.6),
        y_scale="log",
    )
    for axes, level_db in zip(panels, levels_db, strict=True):
        for name in BRACKETS:
            draw_errors(axes, name, {n: errors[level_db, name, n] for n in BRACKET_ACQUISITIONS})
            keys = {2: f"fig7/{name}/2", TABLE_ACQUISITIONS: f"table2/{name}", 28: f"fig7/{name}/28"}
            paper_deg = [paper_number(key).value for key in keys.values()]
            draw_paper(axes, name, list(keys), paper_deg, f"{name}, paper")
    shared_legend(figure)
    return figure


def fig8(searches: Sequence[OnlineSearch]) -> Section:
    """Fig. 8: angle of the probe at each acquisition of TS and GSS, one panel for each position.

    Parameters
    ----------
    searches
        Of `online_searches`.
    """
    level_db = max(_levels(searches))
    first = [each for each in searches if each.repeat == 0 and each.method in BRACKETS and each.peak_snr_db == level_db]
    return Section(
        name="fig8",
        title="Fig. 8: track of the probe, positions 1 to 9",
        method=(*_METHOD, f"Shown is the first visit to each position, at a peak SNR of {level_db:g} dB."),
        tables=(
            Table(
                name="fig8",
                caption="Angles reached",
                columns=("position", "method", "acquisition", "angle_deg", "truth_deg"),
                rows=tuple(
                    (search.position, search.method, number, angle_deg, search.truth_deg)
                    for search in first
                    for number, angle_deg in enumerate(search.track_deg, start=1)
                ),
                shown=False,
            ),
        ),
        pictures=(
            Picture(
                name="fig8",
                alt="Probe angle over the acquisitions of TS and GSS beside the marker's angle, nine panels",
                draw=partial(_draw_tracks, first),
            ),
        ),
        remarks=(
            (
                "The paper prints this figure without numbers. It does not say how it counts the positions of the "
                "grid; ours are counted row by row along x."
            ),
        ),
    )


def _draw_tracks(searches: Sequence[OnlineSearch]) -> Figure:
    truths_deg = {each.position: each.truth_deg for each in searches}
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
        for each in searches:
            if each.position == position:
                axes.plot(
                    range(1, len(each.track_deg) + 1),
                    each.track_deg,
                    label=each.method,
                    color=COLOURS[each.method],
                    marker=MARKS[each.method],
                    markersize=3.5,
                    linewidth=1.2,
                )
    shared_legend(figure)
    return figure
