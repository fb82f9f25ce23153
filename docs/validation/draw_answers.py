"""Draws `figures/answers.png` and `figures/methods.svg`: the answers beside their targets, and beside other methods'.

From `docs/data/answers.csv` and `answers-methods.csv`.
"""

from __future__ import annotations

import csv
from pathlib import Path

from markerseek.show import ERROR_BARS, new_figure, save_figure

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "validation" / "figures" / "answers.png"
TABLE = ROOT / "docs" / "data" / "answers.csv"
METHODS_PICTURE = PICTURE.with_name("methods.svg")
METHODS_TABLE = ROOT / "docs" / "data" / "answers-methods.csv"
DRAWN_METHODS = {
    "posterior": "-",
    "weighted average": "--",
    "ternary search": "--",
    "golden-section search": "--",
    "scikit-optimize": "-.",
    "bound, best angles": ":",
}
"""Rows of the table of methods that are drawn, and how."""
PANELS = {
    "error_deg": "mean error of Found, deg",
    "found": "Found, %",
    "covered": "95 % interval covers, %",
    "acquisitions": "acquisitions",
}
COVERED = (93, 98)
"""Target for the coverage, in per cent."""
DOT, TARGET = "#1f5fa8", "#c8501e"


def draw_methods() -> None:
    """Draw the mean error of each method over the number of acquisitions."""
    with METHODS_TABLE.open(encoding="utf-8", newline="") as file:
        head, *rows = list(csv.reader(file))
    figure = new_figure(width_in=7.0, height_in=3.6)
    axes = figure.subplots()
    for name, style in DRAWN_METHODS.items():
        (row,) = (each for each in rows if each[0] == name)
        points = [(int(at), float(value)) for at, value in zip(head[1:], row[1:], strict=True) if value]
        axes.plot(*zip(*points, strict=True), style, marker="o", markersize=3, label=name)
    axes.set(yscale="log", xlabel="acquisitions", ylabel="mean error, deg", xticks=[int(at) for at in head[1:]])
    axes.grid(visible=True, linewidth=0.4)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.02, 0.5))
    save_figure(figure, METHODS_PICTURE)


def main() -> None:
    """Draw a row for each world: a dot with its 95 % interval where it is known, and the target as a line."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    figure = new_figure(width_in=11.0, height_in=6.0)
    panels = figure.subplots(1, len(PANELS), sharey=True)
    for axes, (key, title) in zip(panels, PANELS.items(), strict=True):
        for place, row in enumerate(rows):
            if not row[key]:
                continue
            mean = float(row[key])
            low, high = (float(row.get(f"{key}_{end}") or mean) for end in ("low", "high"))
            axes.errorbar([mean], [place], xerr=[[mean - low], [high - mean]], fmt="o", color=DOT, **ERROR_BARS)
            if target := row.get(f"target_{key}"):
                axes.plot([float(target)] * 2, [place - 0.4, place + 0.4], color=TARGET, linewidth=1.5)
        if key == "covered":
            axes.axvspan(*COVERED, color=TARGET, alpha=0.2, linewidth=0)
        axes.set_title(title, fontsize=9)
        axes.grid(visible=True, linewidth=0.4)
    panels[0].set_yticks(range(len(rows)), labels=[row["world"] for row in rows], fontsize=8)
    panels[0].set(ylim=(len(rows) - 0.4, -0.6), xlim=(0, None))
    save_figure(figure, PICTURE)
    draw_methods()


if __name__ == "__main__":
    main()
