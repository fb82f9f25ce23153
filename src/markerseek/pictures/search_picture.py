"""Figure of a search: intensity over angle, the probe's track, and the final photoacoustic image."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import Found, PaImage, Sample
from markerseek.pictures.image_panel import draw_image
from markerseek.pictures.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, put_heading

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from markerseek.core import Estimate


_Numbered: TypeAlias = list[tuple[tuple[float, float], str]]
"""Points and their labels."""

_ROOM = (0.013, 0.05)
"""Size of a digit relative to the width and height of the axes, in the narrower layout with an image."""


def search_figure(
    samples: list[Sample],
    estimate: Estimate,
    *,
    title: str | None,
    start_deg: float,
    truth_deg: float | None,
    reference_deg: float | None,
    confirmation: Sample | None,
    image: PaImage | None,
) -> Figure:
    """Figure of one search.

    Parameters
    ----------
    samples
        Acquisitions in the order in which they were made; dark ones apart.
    estimate
        The answer.
    title
        Method and rig, with "simulated" if it is; None if the page around the figure has them.
    start_deg
        Angle of the probe at the start, in degrees.
    truth_deg, reference_deg
        Angle of the marker in degrees in a simulation, or found otherwise; None where it is not known.
    confirmation
        The acquisition after the last move, None if there was none.
    image
        Image of the last acquisition, None where there are no channel data.
    """
    figure = new_figure(width_in=11.0, height_in=6.4)
    if title is not None:
        put_heading(figure, title)
    # Without an image the right column is narrow, not absent: the left panels are the same in both.
    columns = figure.add_gridspec(2, 2, height_ratios=(3, 2), width_ratios=(3, 2 if image is not None else 0.001))
    curve, track = figure.add_subplot(columns[0, 0]), figure.add_subplot(columns[1, 0])
    known = ("reference", reference_deg) if truth_deg is None else ("truth", truth_deg)
    _draw_curve(curve, samples, estimate, known=known, confirmation=confirmation)
    _draw_track(track, samples, estimate, start_deg=start_deg, known=known, confirmation=confirmation)
    if image is not None:
        panel = figure.add_subplot(columns[:, 1])
        draw_image(panel, image.envelope, lateral_m=image.lateral_m, depth_m=image.depth_m)
        last = confirmation or samples[-1]
        reading = last.reading
        if isinstance(estimate, Found) and reading.lateral_m is not None and reading.depth_m is not None:
            place_mm = (1e3 * reading.lateral_m, 1e3 * reading.depth_m)
            panel.plot(*place_mm, marker="o", markersize=16, markerfacecolor="none", color=ACCENT)
        which = "photoacoustic image" if confirmation is not None else "image of the last acquisition,"
        panel.set_title(f"{which} at {last.angle_deg:.2f}°", fontsize=10)
    return figure


def _draw_curve(
    axes: Axes,
    samples: list[Sample],
    estimate: Estimate,
    *,
    known: tuple[str, float | None],
    confirmation: Sample | None,
) -> None:
    angles = np.array([sample.angle_deg for sample in samples])
    intensities = np.array([sample.reading.intensity for sample in samples])
    # Stems, because a line from point to point would look like a measured curve.
    axes.vlines(angles, 0, intensities, color=QUIET, linewidth=1, zorder=1)
    axes.scatter(angles, intensities, color=SIGNAL, s=28, zorder=3, label="acquisitions, numbered where there is room")
    if confirmation is not None:
        axes.scatter(
            [confirmation.angle_deg],
            [confirmation.reading.intensity],
            marker="*",
            s=110,
            color=ACCENT,
            zorder=4,
            label="confirmation" if estimate.floor is not None else "acquisition at that angle",
        )
    _draw_answer(axes.axvline, axes.axvspan, estimate, known)
    floor = estimate.floor
    if floor is not None and floor.level is not None:
        axes.axhline(floor.level, color=QUIET, linestyle=":", label=f"floor ({floor.source})")
    heights = [*intensities.tolist(), 0.0 if confirmation is None else confirmation.reading.intensity]
    if floor is not None and floor.level is not None:
        heights.append(floor.level)
    axes.set_ylim(bottom=0, top=1.12 * max(*heights, 1e-12))
    for place, numbers in _with_room(axes, _numbered(angles.tolist(), intensities.tolist())):
        axes.annotate(numbers, place, xytext=(0, 5), textcoords="offset points", ha="center", fontsize=7)
    axes.set_xlabel("probe angle [deg]")
    axes.set_ylabel("intensity (envelope peak)")
    axes.legend(loc="best", fontsize=7, framealpha=0.8)


def _numbered(angles_deg: list[float], intensities: list[float]) -> _Numbered:
    """Points and the numbers of their acquisitions; repeated points (as in a replay) get one label."""
    numbers: dict[tuple[float, float], list[int]] = {}
    for number, place in enumerate(zip(angles_deg, intensities, strict=True), start=1):
        numbers.setdefault(place, []).append(number)
    return [(place, f"{first}" if not more else f"{first} …") for place, (first, *more) in numbers.items()]


def _with_room(axes: Axes, numbered: _Numbered) -> _Numbered:
    """Points whose labels do not overlap earlier ones; the axes must have their final range."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    digit, line = _ROOM[0] * (right - left), _ROOM[1] * (top - bottom)
    shown: _Numbered = []
    for (x, y), text in numbered:
        if not any(
            abs(x - other_x) < digit * (len(text) + len(other)) / 2 and abs(y - other_y) < line
            for (other_x, other_y), other in shown
        ):
            shown.append(((x, y), text))
    return shown


def _draw_track(
    axes: Axes,
    samples: list[Sample],
    estimate: Estimate,
    *,
    start_deg: float,
    known: tuple[str, float | None],
    confirmation: Sample | None,
) -> None:
    angles = [start_deg, *(sample.angle_deg for sample in samples)]
    axes.step(range(len(angles)), angles, where="mid", color=QUIET, linewidth=1)
    axes.scatter(range(1, len(angles)), angles[1:], color=SIGNAL, s=16, zorder=3)
    if confirmation is not None:
        axes.scatter([len(angles)], [confirmation.angle_deg], marker="*", s=110, color=ACCENT, zorder=4)
    _draw_answer(axes.axhline, axes.axhspan, estimate, known)
    axes.set_xlabel("acquisition (0: start)")
    axes.set_ylabel("probe angle [deg]")
    axes.locator_params(axis="x", integer=True)


def _draw_answer(
    line: Callable[..., object], span: Callable[..., object], estimate: Estimate, known: tuple[str, float | None]
) -> None:
    """Lines at the estimate and at the known angle, and a band for the interval, along either axis."""
    found = isinstance(estimate, Found)
    # Only the paper's form of a method asks for no noise floor: it always answers, and claims nothing.
    claimed = found and estimate.floor is not None
    line(
        estimate.mean_deg,
        color=ACCENT,
        linestyle="-" if found else "--",
        label=f"{'estimate' if claimed else 'no marker is claimed; angle of the method'} {estimate.mean_deg:.2f}°",
    )
    if isinstance(estimate, Found) and claimed:
        interval = estimate.interval95_deg
        bracket = estimate.interval_kind == "bracket"
        kind = "last bracket" if bracket else f"95 % interval ({estimate.interval_kind})"
        span(interval.low_deg, interval.high_deg, color=ACCENT, alpha=0.15, label=kind)
    name, known_deg = known
    if known_deg is not None:
        line(known_deg, color=TRUTH, linestyle=":", label=f"{name} {known_deg:.2f}°")
