"""Figures of searches: of one, with intensity, track and final photoacoustic image, and of several in comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import Ambiguous, AtBound, Estimate, Float64, Found, Interval, PaImage, Sample, Unsure
from markerseek.show.frame_picture import draw_image
from markerseek.show.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_Numbered: TypeAlias = list[tuple[tuple[float, float], str]]
"""Points and their labels."""

Curve: TypeAlias = tuple[Sequence[float] | Float64[np.ndarray, " n"], Sequence[float] | Float64[np.ndarray, " n"]]
"""Angles in degrees, and a value at each."""

INSET_DEG = 2.0
"""Half of the range of the inset about the answer, in degrees."""

_MIN_DENSITY = 1e-5
"""Smallest density drawn, over the largest."""

_ROOM = (0.013, 0.05)
"""Size of a digit relative to the width and height of the axes, in the narrower layout with an image."""


def search_figure(
    samples: list[Sample],
    estimate: Estimate,
    *,
    start_deg: float,
    truth_deg: float | None,
    reference_deg: float | None,
    confirmation: Sample | None,
    pictured: Sample | None = None,
    image: PaImage | None,
    limits: Interval,
    density: Curve | None = None,
    recorded: Curve | None = None,
    stand_in: str | None = None,
) -> Figure:
    """Figure of one search.

    - ``samples``: acquisitions in the order in which they were made; dark ones apart.
    - ``truth_deg``, ``reference_deg``: angle of the marker in degrees in a simulation, or found otherwise; None where
      it is not known.
    - ``confirmation``: the acquisition after the last move, None if there was none.
    - ``pictured``: acquisition whose image is shown; None: `pictured_sample` of ``samples``.
    - ``image``: its image, None if there are no channel data.
    - ``limits``: range of the search, which both axes of angles show.
    - ``density``: angles in degrees, and the posterior's density at each per degree; None for methods without one.
    - ``recorded``: angles in degrees, and the intensities recorded there, of the scan that a replay searches; the
      ``samples`` are then those of the search.
    - ``stand_in``: what was simulated or emulated, in words; None if nothing was.
    """
    # Without a heading: the page or the paper around it says of what rig it is.
    figure = new_figure(width_in=11.0, height_in=7.0 if density is None else 8.0)
    # Without an image the right column is narrow, not absent: the left panels are the same in both.
    rows = (3, 2) if density is None else (3, 1, 2)
    columns = figure.add_gridspec(len(rows), 2, height_ratios=rows, width_ratios=(3, 2 if image is not None else 0.001))
    curve, track = figure.add_subplot(columns[0, 0]), figure.add_subplot(columns[-1, 0])
    # A little more, so that points at the ends of the range are whole.
    margin_deg = 0.02 * limits.width_deg
    shown = (min(limits.low_deg, start_deg) - margin_deg, max(limits.high_deg, start_deg) + margin_deg)
    curve.set_xlim(shown)
    track.set_ylim(shown)
    known = ("reference", reference_deg) if truth_deg is None else ("truth", truth_deg)
    _draw_curve(curve, samples, estimate, known=known, confirmation=confirmation, recorded=recorded)
    _draw_inset(curve, samples, estimate, known=known, density=density)
    curve.set_ylabel("intensity (envelope peak) " + ("[as recorded]" if image is None else "[counts]"))
    _draw_track(track, samples, estimate, start_deg=start_deg, known=known, confirmation=confirmation)
    if recorded is not None:
        track.set_xlabel("acquisition of a search (0: start)")
    if density is not None:
        posterior = figure.add_subplot(columns[1, 0], sharex=curve)
        _draw_density(posterior, density, estimate, known=known)
    if image is not None:
        panel = figure.add_subplot(columns[:, 1])
        # Its upper edge is that of the curve beside it.
        panel.set_anchor("N")
        draw_image(panel, image)
        pictured = pictured or pictured_sample(samples, confirmation)
        reading = pictured.reading
        if isinstance(estimate, Found) and reading.lateral_m is not None and reading.depth_m is not None:
            place_mm = (1e3 * reading.lateral_m, 1e3 * reading.depth_m)
            panel.plot(*place_mm, marker="o", markersize=16, markerfacecolor="none", color=ACCENT)
        which = "photoacoustic image" if confirmation is not None else "image of the strongest acquisition,"
        panel.set_title(f"{which} at {pictured.angle_deg:.2f}°", fontsize=10)
    # The labels of the left column stand in one line, whatever the widths of the numbers beside them.
    figure.align_ylabels([curve, *([] if density is None else [posterior]), track])
    shared_legend(figure, columns=4, title=stand_in)
    return figure


def pictured_sample(samples: Sequence[Sample], confirmation: Sample | None) -> Sample:
    """The acquisition whose image the figure shows: the confirmation; without one, the strongest."""
    return confirmation or max(samples, key=lambda sample: sample.reading.intensity)


def _draw_curve(
    axes: Axes,
    samples: list[Sample],
    estimate: Estimate,
    *,
    known: tuple[str, float | None],
    confirmation: Sample | None,
    recorded: Curve | None,
) -> None:
    angles = [sample.angle_deg for sample in samples]
    intensities = [sample.reading.intensity for sample in samples]
    heights = [1e-12, *intensities]
    if recorded is not None:
        axes.plot(*recorded, color=QUIET, linewidth=1, zorder=1, label="recorded")
        heights.append(float(np.max(recorded[1])))
    # Stems, because a line from point to point would look like a measured curve.
    axes.vlines(angles, 0, intensities, color=QUIET, linewidth=1, zorder=1)
    who = "acquisitions" if recorded is None else "acquisitions of a search"
    axes.scatter(angles, intensities, color=SIGNAL, s=28, zorder=3, label=f"{who}, numbered where there is room")
    if confirmation is not None:
        heights.append(confirmation.reading.intensity)
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
        heights.append(floor.level)
        axes.axhline(floor.level, color=QUIET, linestyle=":", label=f"detection threshold ({floor.source})")
    axes.set_ylim(bottom=0, top=1.12 * max(heights))
    for place, numbers in _with_room(axes, _numbered(angles, intensities)):
        # Beside the star, not under it.
        near = confirmation is not None and _near(axes, place, (confirmation.angle_deg, confirmation.reading.intensity))
        axes.annotate(
            numbers,
            place,
            xytext=(-9, -3) if near else (0, 5),
            textcoords="offset points",
            ha="right" if near else "center",
            fontsize=7,
        )
    axes.set_xlabel("probe angle [deg]")


def _draw_inset(
    axes: Axes, samples: list[Sample], estimate: Estimate, *, known: tuple[str, float | None], density: Curve | None
) -> None:
    """Draw what lies within `INSET_DEG` of an answer that is one line in the whole range."""
    low_deg, high_deg = axes.get_xlim()
    if not isinstance(estimate, Found | Unsure) or estimate.interval95_deg.width_deg > 0.06 * (high_deg - low_deg):
        return
    # On the side of the answer where there is more room.
    left = estimate.mean_deg > (low_deg + high_deg) / 2
    inset = axes.inset_axes((0.05 if left else 0.67, 0.52, 0.28, 0.4))
    inset.set_xlim(estimate.mean_deg - INSET_DEG, estimate.mean_deg + INSET_DEG)
    top = axes.get_ylim()[1]
    inset.set_ylim(0, top)
    if density is not None:
        per_deg = np.asarray(density[1])
        inset.fill_between(np.asarray(density[0]), 0, per_deg * (0.95 * top / per_deg.max()), color=SIGNAL, alpha=0.3)
    intensities = [each.reading.intensity for each in samples]
    inset.scatter([each.angle_deg for each in samples], intensities, color=SIGNAL, s=14, zorder=3)
    _draw_answer(inset.axvline, inset.axvspan, estimate, known)
    inset.set_yticks([])
    inset.tick_params(labelsize=7)
    inset.set_title(f"± {INSET_DEG:g}° about the answer", fontsize=8)


def _numbered(angles_deg: list[float], intensities: list[float]) -> _Numbered:
    """Points and the numbers of their acquisitions; repeated points (as in a replay) get one label."""
    numbers: dict[tuple[float, float], list[int]] = {}
    for number, place in enumerate(zip(angles_deg, intensities, strict=True), start=1):
        numbers.setdefault(place, []).append(number)
    return [(place, f"{first}" if not more else f"{first} …") for place, (first, *more) in numbers.items()]


def _with_room(axes: Axes, numbered: _Numbered) -> _Numbered:
    """Points whose labels leave half a digit to earlier ones; the axes must have their final range."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    digit, line = _ROOM[0] * (right - left), _ROOM[1] * (top - bottom)
    shown: _Numbered = []
    for (x, y), text in numbered:
        if not any(
            abs(x - other_x) < digit * ((len(text) + len(other)) / 2 + 0.5) and abs(y - other_y) < line
            for (other_x, other_y), other in shown
        ):
            shown.append(((x, y), text))
    return shown


def _near(axes: Axes, place: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether a number above one point would be hidden by a star at the other."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    digit, line = _ROOM[0] * (right - left), _ROOM[1] * (top - bottom)
    return abs(place[0] - other[0]) < 1.5 * digit and abs(place[1] - other[1]) < 2 * line


def _draw_density(axes: Axes, density: Curve, estimate: Estimate, *, known: tuple[str, float | None]) -> None:
    angles, per_deg = (np.asarray(each) for each in density)
    most = float(per_deg.max())
    # Logarithmic: at the end of a search nearly all of it lies within a tenth of a degree.
    axes.set_yscale("log")
    axes.set_ylim(_MIN_DENSITY * most, 3 * most)
    axes.fill_between(angles, 0.1 * _MIN_DENSITY * most, per_deg, color=SIGNAL, alpha=0.4)
    _draw_answer(axes.axvline, axes.axvspan, estimate, known)
    axes.set_xlabel("marker angle [deg]")
    axes.set_ylabel("posterior [1/deg]")


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
    # Only the paper's form of a method asks for no detection threshold: it always answers, and claims nothing.
    claimed = found and estimate.floor is not None
    angles_deg: tuple[float, ...] = (estimate.mean_deg,)
    if claimed:
        label = f"estimate {estimate.mean_deg:.2f}°"
    elif isinstance(estimate, Ambiguous):
        angles_deg = estimate.modes_deg
        label = f"no marker is claimed; it may be at {' or '.join(f'{each:.2f}°' for each in angles_deg)}"
    else:
        name = "best guess" if isinstance(estimate, AtBound | Unsure) else "angle of the method"
        label = f"no marker is claimed; {name} {estimate.mean_deg:.2f}°"
    for number, angle_deg in enumerate(angles_deg):
        line(angle_deg, color=ACCENT, linestyle="-" if found else "--", label=None if number else label)
    if isinstance(estimate, Found) and claimed:
        interval = estimate.interval95_deg
        bracket = estimate.interval_kind == "bracket"
        kind = "last bracket" if bracket else f"95 % interval ({estimate.interval_kind})"
        span(interval.low_deg, interval.high_deg, color=ACCENT, alpha=0.15, label=kind)
    name, known_deg = known
    if known_deg is not None:
        line(known_deg, color=TRUTH, linestyle=":", label=f"{name} {known_deg:.2f}°")


_COLOURS = (SIGNAL, ACCENT, "#5b2a86", "#b58900", "#0e7c86", "#b0307a", QUIET)
"""Without green, which is the truth's."""

_MARKERS = "osD^vP*X"


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedSearch:
    """One search: the method's name, its acquisitions in order, its answer, and the angle at which it began."""

    name: str
    samples: Sequence[Sample]
    estimate: Estimate
    start_deg: float


def comparison_figure(
    searches: Sequence[ComparedSearch], *, title: str, limits: Interval, truth_deg: float | None
) -> Figure:
    """Figure of several searches.

    ``title``: the rig, with "simulated" if it is. ``truth_deg``: true angle of the marker, None if not known.
    """
    figure = new_figure(width_in=10.0, height_in=7.0, heading=title)
    curve, track = figure.subplots(2, 1, height_ratios=(3, 2))
    for number, each in enumerate(searches):
        style = {"color": _COLOURS[number % len(_COLOURS)], "marker": _MARKERS[number % len(_MARKERS)]}
        found = isinstance(each.estimate, Found)
        label = f"{each.name}, {len(each.samples)} acquisitions: {each.estimate.mean_deg:.2f}°" + (
            "" if found else " (not claimed)"
        )
        angles = [sample.angle_deg for sample in each.samples]
        intensities = [sample.reading.intensity for sample in each.samples]
        curve.plot(angles, intensities, linestyle="", markersize=5, alpha=0.8, label=label, **style)
        curve.axvline(each.estimate.mean_deg, color=style["color"], linewidth=1, linestyle="-" if found else "--")
        track.plot(range(len(angles) + 1), [each.start_deg, *angles], markersize=4, linewidth=1, alpha=0.8, **style)
    if truth_deg is not None:
        curve.axvline(truth_deg, color=TRUTH, linestyle=":", label=f"truth {truth_deg:.2f}°")
        track.axhline(truth_deg, color=TRUTH, linestyle=":")
    curve.set_xlim(limits.low_deg, limits.high_deg)
    curve.set_ylim(bottom=0)
    curve.set_xlabel("probe angle [deg]")
    curve.set_ylabel("intensity (envelope peak) [counts]")
    track.set_ylim(limits.low_deg, limits.high_deg)
    track.set_xlabel("acquisition (0: start)")
    track.set_ylabel("probe angle [deg]")
    track.locator_params(axis="x", integer=True)
    shared_legend(figure, columns=3)
    return figure
