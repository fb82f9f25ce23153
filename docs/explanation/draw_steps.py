"""Draws a picture for each step of the posterior search into `figures` (`make figures`)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import markerseek
from markerseek.search.curve import log_curve
from markerseek.search.posterior.arrival import off_plane
from markerseek.search.posterior.likelihood import TABLE_HIGH, TABLE_LOW, log_tables
from markerseek.search.posterior.next_angle import Belief
from markerseek.search.posterior.shapes import log_near_field
from markerseek.search.posterior.survey import detection_distance_deg
from markerseek.show import new_figure, save_figure

FOLDER = Path(__file__).parent / "figures"
SHOWN = (1, 2, 3, 4, 5, 10)
"""Acquisitions after which a panel is drawn."""

BLUE, RED, GREY = "#1f5fa8", "#c8501e", "#777777"

NOISE_CELLS = 460_000
"""Independent cells of an image."""


def named(axes: Axes, x: str, y: str) -> None:
    """Name both axes in small letters."""
    axes.set_xlabel(x, fontsize=8)
    axes.set_ylabel(y, fontsize=8)
    axes.tick_params(labelsize=8)


def saved(figure: Figure, name: str) -> None:
    """Write a picture."""
    save_figure(figure, FOLDER / f"{name}.svg")


def draw_curves() -> None:
    """Draw members of the family of curves, (1) and (2)."""
    figure = new_figure(width_in=9.0, height_in=2.6)
    axes = figure.subplots(1, 1)
    away_deg = np.linspace(-20, 20, 801)
    smooth = {"p = 1.2, q = 2.4": (1.2, 2.4), "p = 2.5, q = 2": (2.5, 2.0), "Gaussian": (math.inf, 2.0)}
    for (label, (tail, knee)), style in zip(smooth.items(), ("-", "--", ":"), strict=True):
        heights = np.exp(log_curve(away_deg, fwhm_deg=6.0, tail=tail, knee=knee))
        axes.plot(away_deg, heights, style, color=BLUE, label=label)
    two_peaks = np.exp(log_near_field(away_deg, fwhm_deg=6.0, fresnel_number=1.5))
    axes.plot(away_deg, two_peaks, color=RED, label="near field, n = 1.5")
    axes.legend(fontsize=8, frameon=False)
    named(axes, "angle from the marker t, deg", "S(t)")
    saved(figure, "curves")


def draw_likelihood() -> None:
    """Draw (3) for a weak and a strong sample."""
    figure = new_figure(width_in=9.0, height_in=2.6)
    log_ratio = np.linspace(TABLE_LOW, TABLE_HIGH, log_tables(noise=0.1, cells=1, errors=(0.1,)).shape[1])
    for axes, height in zip(figure.subplots(1, 2), (5.5, 30.0), strict=True):
        table = log_tables(noise=1 / height, cells=NOISE_CELLS, errors=(0.1,))[0]
        axes.plot(np.exp(log_ratio), np.exp(table - table.max()), color=BLUE)
        axes.set(xlim=(0, 2), ylim=(0, 1.05))
        axes.set_title(f"sample of {height:g} σ", fontsize=9)
        named(axes, "height of the curve there, over the sample", "likelihood")
    saved(figure, "likelihood")


def draw_arrival() -> None:
    """Draw (4) and the incidence of (6)."""
    figure = new_figure(width_in=9.0, height_in=2.6)
    left, right = figure.subplots(1, 2)
    away_deg = np.linspace(-30, 30, 301)
    late_s, sine = off_plane(away_deg, 0.010, 0.050)
    left.plot(away_deg, 1e6 * late_s, color=BLUE)
    named(left, "angle from the marker t, deg", "later by D(t), µs")
    right.plot(away_deg, sine**2, color=BLUE)
    named(right, "angle from the marker t, deg", "sin² of the incidence φ")
    saved(figure, "arrival")


def draw_steps() -> None:
    """Search on the simulated rig, and draw what it believes, what it expects of the next sample, and what may hide."""
    rig = markerseek.simulated(seed=1)
    policy = markerseek.build("posterior", limits=rig.limits.search)
    figure = new_figure(width_in=9.0, height_in=4.4)
    panels = figure.subplots(2, 3, sharex=True).ravel()
    dark = [rig.scanner.measure_dark() for _ in range(rig.dark_frames)]
    for sample in dark:
        policy.tell(sample)
    angles_deg: list[float] = []
    intensities: list[float] = []
    while (angle_deg := policy.ask()) is not None:
        sample = rig.scanner.measure(angle_deg)
        policy.tell(sample)
        angles_deg.append(sample.angle_deg)
        intensities.append(sample.reading.intensity)
        if len(angles_deg) not in SHOWN:
            continue
        axes = panels[SHOWN.index(len(angles_deg))]
        belief = policy.belief
        axes.plot(angles_deg, intensities, "o", color=BLUE, markersize=4)
        axes.set(title=f"after {len(angles_deg)}", ylim=(0, 2300), xlim=(-35, 35))
        axes.title.set_fontsize(9)
        axes.axvline(rig.facts.truth_deg, color=RED, linestyle=":", linewidth=1)
        density = axes.twinx()
        density.fill_between(belief.angles_deg, belief.probability, color=BLUE, alpha=0.25)
        density.set(ylim=(0, 1.6 * max(belief.probability)), yticks=[])
        if len(angles_deg) == 5:
            draw_choice(belief, angles_deg)
    for axes in panels[3:]:
        axes.set_xlabel("angle, deg", fontsize=8)
    for axes in panels[::3]:
        axes.set_ylabel("intensity", fontsize=8)
    saved(figure, "steps")
    level = max(sample.reading.intensity for sample in dark)
    draw_reach(angles_deg, peak=max(intensities), level=level)


def draw_choice(belief: Belief, angles_deg: list[float]) -> None:
    """Draw (11): the standard deviation that a sample at each angle is expected to leave."""
    figure = new_figure(width_in=9.0, height_in=2.6)
    axes = figure.subplots(1, 1)
    axes.plot(belief.choice_deg, belief.choice_sigma_deg, ".-", color=BLUE)
    for each in angles_deg:
        axes.axvline(each, color=GREY, linestyle=":", linewidth=1)
    named(axes, "angle of the next sample, deg; dotted: those measured", "expected σ, deg")
    saved(figure, "next-angle")


def draw_reach(angles_deg: list[float], *, peak: float, level: float) -> None:
    """Draw how far from each sample of a search a source as strong would have been detected, (12)."""
    figure = new_figure(width_in=9.0, height_in=1.8)
    axes = figure.subplots(1, 1)
    for width_deg, row in ((3.0, 0), (6.0, 1), (12.0, 2)):
        reach_deg = detection_distance_deg(level=level, peak=peak, fwhm_deg=width_deg)
        for each in angles_deg:
            axes.barh(row, 2 * reach_deg, left=each - reach_deg, color=BLUE, alpha=0.35, height=0.6)
    axes.set(yticks=range(3), yticklabels=["curve of 3°", "6°", "12°"], xlim=(-35, 35))
    named(axes, "angle, deg: where a second source as strong would have been seen", "")
    saved(figure, "reach")


def main() -> None:
    """Draw all of them."""
    draw_curves()
    draw_likelihood()
    draw_arrival()
    draw_steps()


if __name__ == "__main__":
    main()
