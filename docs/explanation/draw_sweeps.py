"""Draws `figures/sweeps.svg`: seconds and errors of both ways to search, from the study `sweeps-readout.toml`."""

from __future__ import annotations

import json
from pathlib import Path

from markerseek.pictures import ERROR_BARS, new_figure, save_figure

SUMMARY = Path("out/sweeps-readout/summary.json")
PICTURE = Path(__file__).parent / "figures" / "sweeps.svg"
READOUT = "rig.receiver.readout_s"
WAYS = {"sweeps": ("#1f5fa8", "o"), "stop and go": ("#c8501e", "s")}


def main() -> None:
    """Draw it."""
    policies = json.loads(SUMMARY.read_text(encoding="utf-8"))["policies"]
    figure = new_figure(width_in=9.0, height_in=3.8)
    panels = figure.subplots(1, 2)
    for axes, key, label in zip(
        panels,
        ("elapsed_s", "error_deg"),
        ("seconds of a search, mean", "error of what is found, mean, degrees"),
        strict=True,
    ):
        for way, (colour, mark) in WAYS.items():
            shown = [each for each in policies if ("sweeping" in each["label"]) == (way == "sweeps")]
            means = [each[key] for each in shown]
            half = [(mean["interval95"][1] - mean["interval95"][0]) / 2 for mean in means]
            axes.errorbar(
                [each["settings"][READOUT] for each in shown],
                [mean["mean"] for mean in means],
                yerr=half,
                color=colour,
                marker=mark,
                label=way,
                **ERROR_BARS,
            )
        axes.set(xscale="log", xlabel="time of a read-out, seconds", ylabel=label)
        axes.set_xticks((0.01, 0.05, 0.2, 1, 3, 10), labels=("0.01", "0.05", "0.2", "1", "3", "10"))
        axes.grid(visible=True, linewidth=0.4)
    panels[0].set_yscale("log")
    panels[0].set_yticks((10, 20, 50, 100, 200), labels=("10", "20", "50", "100", "200"))
    panels[1].set_ylim(bottom=0)
    panels[0].legend()
    save_figure(figure, PICTURE)


if __name__ == "__main__":
    main()
