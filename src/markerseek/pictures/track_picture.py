"""Figure of a marker that was followed: its angle and the probe's over time, and the error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from markerseek.pictures.style import ACCENT, GRID, QUIET, SIGNAL, TRUTH, new_figure, put_heading, shared_legend

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def track_figure(
    time_s: Sequence[float],
    *,
    probe_deg: Sequence[float],
    angle_deg: Sequence[float],
    sigma_deg: Sequence[float],
    truth_deg: Sequence[float],
    title: str,
) -> Figure:
    """Figure of one track.

    Parameters
    ----------
    time_s
        Times of the frames in seconds.
    probe_deg, angle_deg, sigma_deg, truth_deg
        Angle of the probe, estimate of the marker's with its standard deviation, and its true angle, in degrees.
    title
        The rig, and how well the marker was followed.
    """
    figure = new_figure(width_in=9.0, height_in=6.0)
    put_heading(figure, title)
    course, error = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    course.plot(time_s, truth_deg, color=TRUTH, linestyle=":", label="truth (simulated)")
    course.plot(time_s, angle_deg, color=ACCENT, label="estimate")
    course.plot(time_s, probe_deg, color=SIGNAL, linestyle="", marker="o", markersize=3, label="probe at each frame")
    course.set_ylabel("angle [deg]")
    off_deg, band_deg = np.subtract(angle_deg, truth_deg), 1.96 * np.asarray(sigma_deg)
    error.fill_between(time_s, -band_deg, band_deg, color=QUIET, alpha=0.3, label="±1.96 standard deviations")
    error.plot(time_s, off_deg, color=ACCENT, marker="o", markersize=3)
    error.set_ylabel("estimate less truth [deg]")
    error.set_xlabel("time since the marker began to move [s]")
    for axes in (course, error):
        axes.grid(visible=True, color=GRID, linewidth=0.6)
    shared_legend(figure, columns=4)
    return figure
