"""Draws `figures/answers.png`: what `docs/data/answers.csv` says of the answers, beside the targets."""

from __future__ import annotations

import csv
from pathlib import Path

from markerseek.show import ERROR_BARS, new_figure, save_figure

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "explanation" / "figures" / "answers.png"
TABLE = ROOT / "docs" / "data" / "answers.csv"
PANELS = {
    "error_deg": "mean error of Found, deg",
    "found": "Found, %",
    "covered": "95 % interval covers, %",
    "acquisitions": "acquisitions",
}
COVERED = (93, 98)
"""Target for the coverage, in per cent."""
DOT, TARGET = "#1f5fa8", "#c8501e"


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


if __name__ == "__main__":
    main()
