"""Draws `figures/sessions.svg` from the sessions of registration in `docs/data/sessions.csv`.

``python -m benchmarks.registration.sessions --out docs/data/sessions.csv`` runs them.
"""

from __future__ import annotations

import csv
from pathlib import Path

from markerseek.show import new_figure, save_figure

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "data" / "sessions.csv"
PICTURE = ROOT / "docs" / "validation" / "figures" / "sessions.svg"
NAMES = {
    "points": "points",
    "clutter": "eight absorbers",
    "misled": "predictions 15° wrong",
    "muscle": "muscle",
    "liver": "liver",
    "rest": "stop and go, 10 s a read-out",
    "rest-alone": "the same, without the camera",
}
"""Rows, and what they are called."""

BLUE, RED = "#1f5fa8", "#c8501e"


def main() -> None:
    """Draw the figure."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    figure = new_figure(width_in=10.0, height_in=3.2)
    times, errors, curves = figure.subplots(1, 3)
    for place, name in enumerate(NAMES):
        mine = [row for row in rows if row["row"] == name]
        known = [row for row in mine if row["target_error_mm"]]
        rig_s, error_mm = [float(row["rig_s"]) for row in mine], [float(row["target_error_mm"]) for row in known]
        for axes, values in ((times, rig_s), (errors, error_mm)):
            if values:
                axes.plot(values, [place] * len(values), "o", color=BLUE, alpha=0.4, markersize=4)
                axes.plot([sum(values) / len(values)] * 2, [place - 0.3, place + 0.3], color=BLUE, linewidth=2)
    # Those that stop and go take twenty times as long.
    times.set(title="rig's time, s", xscale="log", xlim=(10, 1000))
    errors.set(title="true error at the target, mm", xlim=(0, None))
    times.set_yticks(range(len(NAMES)), labels=list(NAMES.values()), fontsize=8)
    errors.set_yticks(range(len(NAMES)), labels=[])
    times.invert_yaxis()
    errors.invert_yaxis()
    for name, colour, label in (("places", BLUE, "places of the session"), ("grid", RED, "3 × 3 grid in its order")):
        mine = [row for row in rows if row["row"] == name]
        for key, style in (("tre_by_marker_mm", "-"), ("error_by_marker_mm", "--")):
            means = []
            for number in range(3, 10):
                found = [row[key].split()[number - 1] for row in mine]
                values = [float(value) for value in found if value != "-"]
                means.append(sum(values) / len(values) if values else float("nan"))
            said = f"{label}, expected" if style == "-" else None
            curves.plot(range(3, 10), means, style, color=colour, marker="o", markersize=3, label=said)
    curves.set(title="mean TRE, mm; dashed: true", xlabel="markers", ylim=(0, None))
    curves.legend(fontsize=7)
    for axes in (times, errors, curves):
        axes.title.set_fontsize(9)
        axes.grid(visible=True, linewidth=0.4)
    save_figure(figure, PICTURE)


if __name__ == "__main__":
    main()
