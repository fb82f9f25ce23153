"""Fig. 6 (a to e) and Table 1: errors of the offline searches over the number of acquisitions, and at 16 of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.pictures import Line, Panel, panels_figure
from markerseek.studies.paper.look import COLOURS, MARKS, error_line
from markerseek.studies.paper.methods import BRACKETS, NAMES, TABLE_ACQUISITIONS, Name
from markerseek.studies.paper.offline import Answer
from markerseek.studies.paper.reported import MATERIALS, reported
from markerseek.studies.paper.section import Beside, Cell, Errors, Picture, Section, Table, beside, errors_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_Group: TypeAlias = tuple[str, float | None, Name, int]
"""Material, peak SNR, method, number of acquisitions."""

_SIMULATED = (
    (
        "Each bank is a scan of ±35° in 0.5° steps on the simulated rig: channel data, noise, beamforming, envelope. "
        "The materials are simulated stand-ins, set by us and measured on nothing: nine places of a rough 3 × 3 grid "
        "of 20 mm each, one for the stained muscle. The reference is the true angle."
    ),
    (
        "Every bank was made at a peak SNR of 40 dB, the default of the simulated rig, and at 60 dB. Our numbers at "
        "both stand beside the paper's."
    ),
)
_SEARCHES = (
    "The searches are the published ones. They run on the bank through the same loop as on a rig, at angles rounded to "
    "the motor's encoder counts, with linear interpolation between recorded angles; WA makes full scans and leaves out "
    "samples below 0.2 of the largest."
)
_COLUMNS = (
    "material",
    "peak_snr_db",
    "method",
    "acquisitions",
    "searches",
    "mean_error_deg",
    "spread_deg",
    "half_interval95_deg",
    "share_off_by_more_than_4.33_deg",
)


def fig6(answers: Sequence[Answer]) -> Section:
    """Fig. 6: mean error over the number of acquisitions, one panel for each material.

    Parameters
    ----------
    answers
        Of `markerseek.studies.paper.offline.answers`.
    """
    groups = _groups(answers)
    return Section(
        name="fig6",
        title="Fig. 6: offline analysis, mean error over the number of acquisitions",
        method=_method(answers),
        besides=_at_28(groups) if _is_simulated(answers) else (),
        tables=(
            Table(
                name="fig6",
                caption="Errors of the offline searches",
                columns=_COLUMNS,
                rows=tuple(_row(group, _errors(found)) for group, found in groups.items()),
                shown=False,
            ),
            _every_search(answers),
        ),
        pictures=(
            Picture(
                name="fig6",
                alt="Mean error over the number of acquisitions for TS, GSS and WA, one panel for each material",
                draw=partial(_draw, groups),
            ),
        ),
    )


def table1(answers: Sequence[Answer]) -> Section:
    """Table 1: errors after 16 acquisitions.

    Parameters
    ----------
    answers
        Of `markerseek.studies.paper.offline.answers`.
    """
    groups = {group: found for group, found in _groups(answers).items() if group[3] == TABLE_ACQUISITIONS}
    rows = []
    for group, found in groups.items():
        from_maximum = errors_of(np.array([answer.from_maximum_deg for answer in found]))
        rows.append((*_row(group, _errors(found)), from_maximum.mean_deg, from_maximum.spread_deg))
    return Section(
        name="table1",
        title=f"Table 1: offline analysis after {TABLE_ACQUISITIONS} acquisitions",
        method=_method(answers),
        besides=_at_16(groups) if _is_simulated(answers) else (),
        tables=(
            Table(
                name="table1",
                caption="Errors from the reference, and from the largest intensity of the bank itself",
                columns=(*_COLUMNS, "mean_from_maximum_deg", "spread_from_maximum_deg"),
                rows=tuple(rows),
            ),
        ),
    )


def _is_simulated(answers: Sequence[Answer]) -> bool:
    return answers[0].recording.peak_snr_db is not None


def _method(answers: Sequence[Answer]) -> tuple[str, ...]:
    if _is_simulated(answers):
        return (*_SIMULATED, _SEARCHES)
    recording = answers[0].recording
    reference = "given" if recording.reference_deg is not None else "the angle of the bank's largest intensity"
    return (f"The bank is the user's own, {recording.path}; the reference angle is {reference}.", _SEARCHES)


def _groups(answers: Sequence[Answer]) -> dict[_Group, list[Answer]]:
    groups: dict[_Group, list[Answer]] = {}
    for answer in answers:
        recording = answer.recording
        group = (recording.material, recording.peak_snr_db, answer.method, answer.acquisitions)
        groups.setdefault(group, []).append(answer)
    return groups


def _errors(answers: Sequence[Answer]) -> Errors:
    return errors_of(np.array([answer.error_deg for answer in answers]))


def _row(group: _Group, errors: Errors) -> tuple[Cell, ...]:
    return (*group, errors.count, errors.mean_deg, errors.spread_deg, errors.half_deg, errors.failed)


def _every_search(answers: Sequence[Answer]) -> Table:
    return Table(
        name="fig6_searches",
        caption="Every offline search",
        columns=(
            "bank",
            "position",
            "method",
            "acquisitions",
            "angle_deg",
            "reference_deg",
            "bank_maximum_deg",
            "error_deg",
        ),
        rows=tuple(
            (
                answer.recording.path.name,
                answer.recording.position,
                answer.method,
                answer.acquisitions,
                answer.angle_deg,
                answer.reference_deg,
                answer.maximum_deg,
                answer.error_deg,
            )
            for answer in answers
        ),
        shown=False,
    )


def _at_28(groups: dict[_Group, list[Answer]]) -> tuple[Beside, ...]:
    """The conclusion's "below 0.5° on all materials": the largest mean error of TS and of GSS."""
    besides = []
    for level_db in _levels(groups):
        for name in BRACKETS:
            worst = max(
                (
                    _errors(found)
                    for (_, level, method, count), found in groups.items()
                    if (level, method, count) == (level_db, name, 28)
                ),
                key=lambda errors: errors.mean_deg,
            )
            besides.append(beside("fig6/28", worst, condition=f"{name}, the worst material, {level_db:g} dB"))
    return tuple(besides)


def _at_16(groups: dict[_Group, list[Answer]]) -> tuple[Beside, ...]:
    return tuple(
        beside(
            f"table1/{method}/{material}", _errors(groups[material, level_db, method, 16]), condition=f"{level_db:g} dB"
        )
        for material in MATERIALS
        for method in NAMES
        for level_db in _levels(groups)
    )


def _levels(groups: dict[_Group, list[Answer]]) -> list[float | None]:
    return list(dict.fromkeys(level_db for _, level_db, _, _ in groups))


def _draw(groups: dict[_Group, list[Answer]]) -> Figure:
    places = list(dict.fromkeys((level_db, material) for material, level_db, _, _ in groups))
    places.sort(key=lambda place: place[0] or 0.0)
    panels = []
    for level_db, material in places:
        lines = []
        for name in NAMES:
            cells = {
                n: _errors(found)
                for (m, level, method, n), found in groups.items()
                if (m, level, method) == (material, level_db, name)
            }
            lines.append(error_line(name, cells))
            if level_db is not None:
                paper = reported(f"table1/{name}/{material}").mean
                lines.append(
                    Line(
                        label=f"{name}, paper (Table 1)",
                        x=(16.0,),
                        y=(paper,),
                        colour=COLOURS[name],
                        form="mark",
                        mark=MARKS[name],
                    )
                )
        title = material if level_db is None else f"{material}, {level_db:g} dB"
        panels.append(Panel(title=title, lines=tuple(lines)))
    return panels_figure(
        panels,
        title="Offline searches" + (" on simulated stand-ins" if _levels(groups)[0] is not None else ""),
        across="acquisitions N",
        up="mean error [deg]",
        columns=5,
        scale="log",
        panel_in=(2.9, 3.0),
    )
