"""Figure of following: the angle of the target and of the probe over time, the range between them, and the states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from markerseek.show.style import ACCENT, GRID, QUIET, SIGNAL, TRUTH, new_figure, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowedMoment:
    """What the figure shows of one moment."""

    at_s: float
    probe_deg: float
    target_deg: float | None
    """Where the target was measured; None: not yet."""
    within_deg: float
    word: str
    """How it stands, in a word."""
    stays: bool
    """Whether the probe stays because of it."""
    sigma_deg: float | None = None
    """Standard deviation of the target's angle; None: as of ``target_deg``."""
    true_deg: float | None = None
    """Where the target was in truth; None: not known, or it is gone."""


def follow_figure(moments: Sequence[FollowedMoment], *, title: str) -> Figure:
    """Return the figure of a run that followed a target."""
    figure = new_figure(width_in=8.5, height_in=4.8, heading=title, fontsize=10)
    axes, states = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    at_s = [each.at_s for each in moments]
    seen = [each for each in moments if each.target_deg is not None]
    if any(each.true_deg is not None for each in moments):
        true_deg = [float("nan") if each.true_deg is None else each.true_deg for each in moments]
        axes.plot(at_s, true_deg, color=TRUTH, linewidth=1.0, label="target (simulated truth)")
    axes.plot(
        [each.at_s for each in seen], [each.target_deg for each in seen], ".", color=QUIET, markersize=2, label="target"
    )
    axes.plot(at_s, [each.probe_deg for each in moments], color=SIGNAL, linewidth=1.6, label="probe")
    axes.fill_between(
        at_s,
        [each.probe_deg - each.within_deg for each in moments],
        [each.probe_deg + each.within_deg for each in moments],
        color=SIGNAL,
        alpha=0.15,
        linewidth=0,
        label="range of the probe",
    )
    axes.set_ylabel("angle [deg]")
    axes.grid(visible=True, color=GRID, linewidth=0.6)
    words = list(dict.fromkeys(each.word for each in moments))
    for word, run in groupby(moments, lambda each: each.word):
        these = list(run)
        begin_s = these[0].at_s
        row = words.index(word)
        lasts_s = max(these[-1].at_s - begin_s, 0.05)
        states.broken_barh([(begin_s, lasts_s)], (row - 0.4, 0.8), color=ACCENT if these[0].stays else SIGNAL)
    states.set_yticks(range(len(words)), words, fontsize=7)
    states.set_ylim(len(words) - 0.5, -0.5)
    states.set_xlabel("time [s]")
    shared_legend(figure)
    return figure
