"""Draws `figures/steps.svg`: what a search believes after some of its acquisitions (`make figures`)."""

from __future__ import annotations

from pathlib import Path

import markerseek
from markerseek.show import new_figure, save_figure

PICTURE = Path(__file__).parent / "figures/steps.svg"
SHOWN = (1, 2, 3, 4, 5, 10)
"""Acquisitions after which a panel is drawn."""

BLUE, RED = "#1f5fa8", "#c8501e"


def main() -> None:
    """Search on the simulated rig, and draw a panel after each acquisition that is shown."""
    rig = markerseek.simulated(seed=1)
    policy = markerseek.build("posterior", limits=rig.limits.search)
    figure = new_figure(width_in=9.0, height_in=4.4)
    panels = figure.subplots(2, 3, sharex=True).ravel()
    for _ in range(rig.dark_frames):
        policy.tell(rig.scanner.measure_dark())
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
    for axes in panels[3:]:
        axes.set_xlabel("angle, deg", fontsize=8)
    for axes in panels[::3]:
        axes.set_ylabel("intensity", fontsize=8)
    save_figure(figure, PICTURE)


if __name__ == "__main__":
    main()
