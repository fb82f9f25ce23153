"""Figure of several searches of one rig beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markerseek.core import Estimate, Found, Interval, Sample
from markerseek.pictures.style import ACCENT, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
