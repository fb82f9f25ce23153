"""Curves as figures of Matplotlib: of one search with its track and its final image, and of several in comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import PaImage, Sample
from markerseek.records.journal import RunView
from markerseek.show.curve import ANGLE_TEXT, DENSITY_TEXT, INSET_DEG, DrawnCurve, Mark
from markerseek.show.frame_picture import draw_image
from markerseek.show.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, shared_legend
from markerseek.show.words import with_minus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_Numbered: TypeAlias = list[tuple[tuple[float, float], str]]
"""Points and their labels."""

_MIN_DENSITY = 1e-4
"""Smallest density drawn, over the largest."""

_ROOM = (0.013, 0.05)
"""Size of a digit relative to the width and height of the axes, in the narrower layout with an image."""


def curve_figure(curve: DrawnCurve, *, pictured: Sample | None = None, image: PaImage | None = None) -> Figure:
    """Return the figure of one search: its intensities and density over the angle, and the path of the probe.

    ``pictured``: acquisition whose image is shown, from `pictured_sample`. ``image``: its image; None if there are no
    channel data.
    """
    # Without a heading: the page or the paper around it says of what rig it is.
    has_density = curve.most_per_deg > 0
    figure = new_figure(width_in=11.0, height_in=8.0 if has_density else 7.0)
    # Without an image the right column is narrow, not absent: the left panels are the same in both.
    rows = (3, 1, 2) if has_density else (3, 2)
    columns = figure.add_gridspec(len(rows), 2, height_ratios=rows, width_ratios=(3, 2 if image is not None else 0.001))
    intensity = figure.add_subplot(columns[0, 0])
    track = figure.add_subplot(columns[-1, 0])
    left = [intensity, track]
    shown_deg = _shown_deg(curve)
    intensity.set_xlim(shown_deg)
    track.set_ylim(shown_deg)
    _draw_intensities(intensity, curve)
    _draw_inset(intensity, curve)
    _draw_track(track, curve)
    if has_density:
        posterior = figure.add_subplot(columns[1, 0], sharex=intensity)
        _draw_density(posterior, curve)
        left.append(posterior)
    if image is not None and pictured is not None:
        panel = figure.add_subplot(columns[:, 1])
        # Its upper edge is that of the curve beside it.
        panel.set_anchor("N")
        _draw_pictured(panel, curve, pictured, image)
    # The labels of the left column stand in one line, whatever the widths of the numbers beside them.
    figure.align_ylabels(left)
    shared_legend(figure, columns=4, title=curve.stand_in)
    return figure


def pictured_sample(view: RunView) -> Sample:
    """Return the acquisition whose image the figure shows: the confirmation; without one, the strongest."""
    return view.confirmation or max(view.samples, key=lambda sample: sample.reading.intensity)


def _shown_deg(curve: DrawnCurve) -> tuple[float, float]:
    """Return a little more than the range, so that points at its ends are whole."""
    margin_deg = 0.02 * (curve.high_deg - curve.low_deg)
    start_deg = curve.low_deg if curve.start_deg is None else curve.start_deg
    return min(curve.low_deg, start_deg) - margin_deg, max(curve.high_deg, start_deg) + margin_deg


def _searched(curve: DrawnCurve) -> list[Mark]:
    return [each for each in curve.marks if each.role == "search"]


def _confirmations(curve: DrawnCurve) -> list[Mark]:
    return [each for each in curve.marks if each.role == "confirmation"]


def _draw_intensities(axes: Axes, curve: DrawnCurve) -> None:
    searched = _searched(curve)
    confirmations = _confirmations(curve)
    angles_deg = [each.angle_deg for each in searched]
    intensities = [each.intensity for each in searched]
    if curve.recorded:
        axes.plot(curve.recorded_deg, curve.recorded, color=QUIET, linewidth=1, zorder=1, label="recorded")
    # Stems, because a line from point to point would look like a measured curve.
    axes.vlines(angles_deg, 0, intensities, color=QUIET, linewidth=1, zorder=1)
    who = "acquisitions of a search" if curve.recorded else "acquisitions"
    label = f"{who}, numbered where there is room" if any(each.text for each in searched) else "pulses"
    axes.scatter(angles_deg, intensities, color=SIGNAL, s=[_area(each) for each in searched], zorder=3, label=label)
    for each in confirmations:
        place = (each.angle_deg, each.intensity)
        axes.scatter(*place, marker="*", s=110, color=ACCENT, zorder=4, label=curve.confirmation_text)
    _draw_answer(axes.axvline, axes.axvspan, curve)
    if not curve.answers and curve.answer_text:
        axes.plot([], [], linestyle="", label=curve.answer_text)
    if curve.threshold is not None:
        axes.axhline(curve.threshold.level, color=QUIET, linestyle=":", label=curve.threshold.text)
    axes.set_ylim(bottom=0, top=1.12 * curve.top)
    for place, numbers in _with_room(axes, _numbered(searched)):
        # Beside the star, not under it.
        is_near = any(_near(axes, place, (each.angle_deg, each.intensity)) for each in confirmations)
        axes.annotate(
            numbers,
            place,
            xytext=(-9, -3) if is_near else (0, 5),
            textcoords="offset points",
            ha="right" if is_near else "center",
            fontsize=7,
        )
    axes.set_xlabel(ANGLE_TEXT)
    axes.set_ylabel(curve.intensity_text)


def _area(mark: Mark) -> float:
    """Return the area of a dot in square points; in a weighted average it is its weight."""
    return 28.0 if mark.weight is None else 6 + 40 * mark.weight


def _draw_inset(axes: Axes, curve: DrawnCurve) -> None:
    if curve.inset_deg is None:
        return
    # On the side of the answer where there is more room.
    is_left = sum(curve.inset_deg) > sum(axes.get_xlim())
    inset = axes.inset_axes((0.05 if is_left else 0.67, 0.52, 0.28, 0.4))
    inset.set_xlim(curve.inset_deg)
    top = axes.get_ylim()[1]
    inset.set_ylim(0, top)
    if curve.most_per_deg:
        heights = np.asarray(curve.density_per_deg) * (0.95 * top / curve.most_per_deg)
        inset.fill_between(curve.density_deg, 0, heights, color=SIGNAL, alpha=0.3)
    searched = _searched(curve)
    intensities = [each.intensity for each in searched]
    inset.scatter([each.angle_deg for each in searched], intensities, color=SIGNAL, s=14, zorder=3)
    _draw_answer(inset.axvline, inset.axvspan, curve)
    inset.set_yticks([])
    inset.tick_params(labelsize=7)
    inset.set_title(f"± {INSET_DEG:g}° about the answer", fontsize=8)


def _numbered(marks: Sequence[Mark]) -> _Numbered:
    """Return the points and the numbers of their acquisitions; repeated points (as in a replay) get one label."""
    numbers: dict[tuple[float, float], list[str]] = {}
    for each in marks:
        numbers.setdefault((each.angle_deg, each.intensity), []).append(each.text)
    return [(place, first if not more else f"{first} …") for place, (first, *more) in numbers.items() if first]


def _with_room(axes: Axes, numbered: _Numbered) -> _Numbered:
    """Return the points whose labels leave half a digit to earlier ones; the axes must have their final range."""
    (left, right) = axes.get_xlim()
    (bottom, top) = axes.get_ylim()
    digit = _ROOM[0] * (right - left)
    line = _ROOM[1] * (top - bottom)
    shown: _Numbered = []
    for (x, y), text in numbered:
        if not any(
            abs(x - other_x) < digit * ((len(text) + len(other)) / 2 + 0.5) and abs(y - other_y) < line
            for (other_x, other_y), other in shown
        ):
            shown.append(((x, y), text))
    return shown


def _near(axes: Axes, place: tuple[float, float], other: tuple[float, float]) -> bool:
    """Return whether a number above one point would be hidden by a star at the other."""
    (left, right) = axes.get_xlim()
    (bottom, top) = axes.get_ylim()
    digit = _ROOM[0] * (right - left)
    line = _ROOM[1] * (top - bottom)
    return abs(place[0] - other[0]) < 1.5 * digit and abs(place[1] - other[1]) < 2 * line


def _draw_density(axes: Axes, curve: DrawnCurve) -> None:
    most_per_deg = curve.most_per_deg
    least_per_deg = _MIN_DENSITY * most_per_deg
    # Logarithmic: at the end of a search nearly all of it lies within a tenth of a degree.
    axes.set_yscale("log")
    axes.set_ylim(least_per_deg, 3 * most_per_deg)
    # Zero has no logarithm.
    heights = np.maximum(curve.density_per_deg, 0.1 * least_per_deg)
    axes.fill_between(curve.density_deg, 0.1 * least_per_deg, heights, color=SIGNAL, alpha=0.4)
    if len(curve.answers) > 1:
        # The posterior is that of one source; the other one has its own.
        likeliest_deg = curve.density_deg[int(np.argmax(curve.density_per_deg))]
        axes.set_title(with_minus(f"if the source at {likeliest_deg:.1f}° is the marker"), fontsize=8)
    _draw_answer(axes.axvline, axes.axvspan, curve)
    axes.set_xlabel("marker angle [deg]")
    axes.set_ylabel(DENSITY_TEXT)


def _draw_track(axes: Axes, curve: DrawnCurve) -> None:
    axes.step(*_way(curve), where="mid", color=QUIET, linewidth=1)
    for number, each in enumerate(curve.marks, start=1):
        if each.role == "confirmation":
            axes.scatter([number], [each.angle_deg], marker="*", s=110, color=ACCENT, zorder=4)
        else:
            axes.scatter([number], [each.angle_deg], color=SIGNAL, s=16, zorder=3)
    _draw_answer(axes.axhline, axes.axhspan, curve)
    axes.set_xlabel("acquisition of a search (0: start)" if curve.recorded else "acquisition (0: start)")
    axes.set_ylabel(ANGLE_TEXT)
    axes.locator_params(axis="x", integer=True)


def _way(curve: DrawnCurve) -> tuple[range, list[float]]:
    """Return the numbers of the acquisitions, 0 for the start, and the angle of the probe at each."""
    angles_deg = [each.angle_deg for each in curve.marks]
    if curve.start_deg is None:
        return range(1, 1 + len(angles_deg)), angles_deg
    return range(1 + len(angles_deg)), [curve.start_deg, *angles_deg]


def _draw_answer(line: Callable[..., object], span: Callable[..., object], curve: DrawnCurve) -> None:
    """Lines at the angles of a curve, and bands for its intervals, along either axis."""
    style = "-" if curve.is_claimed else "--"
    for number, each in enumerate(curve.answers):
        line(each.angle_deg, color=ACCENT, linestyle=style, label=None if number else curve.answer_text)
    for number, each in enumerate(curve.others):
        line(each.angle_deg, color=QUIET, linestyle="--", label=None if number else "other source")
    for band, colour in ((curve.bracket, QUIET), (curve.interval, ACCENT)):
        if band is not None:
            span(band.low_deg, band.high_deg, color=colour, alpha=0.15, label=band.text)
    if curve.known is not None:
        line(curve.known.angle_deg, color=TRUTH, linestyle=":", label=curve.known.text)


def _draw_pictured(axes: Axes, curve: DrawnCurve, pictured: Sample, image: PaImage) -> None:
    draw_image(axes, image)
    reading = pictured.reading
    if curve.is_claimed and reading.lateral_m is not None and reading.depth_m is not None:
        place_mm = (1e3 * reading.lateral_m, 1e3 * reading.depth_m)
        axes.plot(*place_mm, marker="o", markersize=16, markerfacecolor="none", color=ACCENT)
    which = "photoacoustic image" if curve.marks[-1].role == "confirmation" else "image of the strongest acquisition,"
    axes.set_title(with_minus(f"{which} at {pictured.angle_deg:.2f}°"), fontsize=10)


_COLOURS = (SIGNAL, ACCENT, "#5b2a86", "#b58900", "#0e7c86", "#b0307a", QUIET)
"""Without green, which is the truth's."""

_MARKERS = "osD^vP*X"


def comparison_figure(curves: Sequence[tuple[str, DrawnCurve]], *, title: str) -> Figure:
    """Return the figure of several searches of one marker, each with the name of its method.

    ``title``: the rig, with "simulated" if it is.
    """
    figure = new_figure(width_in=10.0, height_in=7.0, heading=title)
    intensity, track = figure.subplots(2, 1, height_ratios=(3, 2))
    for number, (name, curve) in enumerate(curves):
        colour = _COLOURS[number % len(_COLOURS)]
        marker = _MARKERS[number % len(_MARKERS)]
        searched = _searched(curve)
        angles_deg = [each.angle_deg for each in searched]
        where = " or ".join(each.text for each in curve.answers) or "nothing detected"
        claim = "" if curve.is_claimed or not curve.answers else " (not claimed)"
        intensity.plot(
            angles_deg,
            [each.intensity for each in searched],
            color=colour,
            marker=marker,
            markersize=5,
            linestyle="",
            alpha=0.8,
            label=f"{name}, {len(searched)} acquisitions: {where}{claim}",
        )
        for each in curve.answers:
            intensity.axvline(each.angle_deg, color=colour, linewidth=1, linestyle="-" if curve.is_claimed else "--")
        track.plot(*_way(curve), color=colour, marker=marker, markersize=4, linewidth=1, alpha=0.8)
    first = curves[0][1]
    if first.known is not None:
        intensity.axvline(first.known.angle_deg, color=TRUTH, linestyle=":", label=first.known.text)
        track.axhline(first.known.angle_deg, color=TRUTH, linestyle=":")
    intensity.set_xlim(first.low_deg, first.high_deg)
    intensity.set_ylim(bottom=0)
    intensity.set_xlabel(ANGLE_TEXT)
    intensity.set_ylabel(first.intensity_text)
    track.set_ylim(first.low_deg, first.high_deg)
    track.set_xlabel("acquisition (0: start)")
    track.set_ylabel(ANGLE_TEXT)
    track.locator_params(axis="x", integer=True)
    shared_legend(figure, columns=3)
    return figure
