"""Draws `figures/sweeps.svg` and writes `docs/data/sweeps.csv`, from the studies of sweeps that were run.

Run each study of `STUDIES` with `markerseek study` first.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from markerseek.show import ERROR_BARS, new_figure, save_figure

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "validation" / "figures" / "sweeps.svg"
TABLE = ROOT / "docs" / "data" / "sweeps.csv"
STUDIES = {"sweeps-timing-known": "delay known to 1 ms", "sweeps-timing": "delay not known"}
PANELS = ("answer known, s", "mean error of found, deg", "found, %", "95 % interval covers, %")
TARGETS = {
    # Peak SNR in dB, from an end of the range, delay known: seconds, error, share found.
    (40.0, True, True): (5.0, 0.18, 98.0),
    (40.0, False, True): (7.5, 0.18, 98.0),
    (30.0, True, True): (7.5, 0.3, 95.0),
    (30.0, False, True): (10.0, 0.3, 95.0),
    (40.0, True, False): (7.5, 0.18, 98.0),
    (30.0, True, False): (10.0, 0.3, 95.0),
}
"""What was asked for."""


def rows() -> list[dict[str, Any]]:
    """One row for each cell of each study."""
    table = []
    for name, delay in STUDIES.items():
        summary = json.loads((ROOT / "out" / name / "summary.json").read_text(encoding="utf-8"))
        for each in summary["policies"]:
            found = each["answers"]["found"]
            shares = {"found": found, "covered": each["covered"]}
            means = {"known_s": each["known_s"], "elapsed_s": each["elapsed_s"], "error_deg": each["error_deg"]}
            table.append(
                {
                    "delay": delay,
                    "start_deg": each["settings"]["rig.start_deg"],
                    "peak_snr_db": each["settings"]["rig.noise.peak_snr_db"],
                    "searches": each["trials"],
                    "beyond_twice_the_tolerance": each["wrong_claims"]["hits"],
                }
                | {f"{key}_{end}": value for key, share in shares.items() for end, value in ends(share, 100.0)}
                | {f"{key}_{end}": value for key, mean in means.items() for end, value in ends(mean, 1.0)}
            )
    return table


def ends(value: dict[str, Any], scale: float) -> list[tuple[str, float]]:
    """A mean or a share, and both ends of its 95 % interval."""
    middle = value["share"] if "share" in value else value["mean"]
    low, high = value["interval95"]
    return [("mean", scale * middle), ("low", scale * low), ("high", scale * high)]


def main() -> None:
    """Write the table, and draw it."""
    table = rows()
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {key: round(value, 4) if isinstance(value, float) else value for key, value in row.items()} for row in table
        )
    figure = new_figure(width_in=10.0, height_in=3.6)
    panels = figure.subplots(1, 4, sharey=True)
    names = [
        f"{row['delay']}, {row['peak_snr_db']:g} dB, from {'an end' if row['start_deg'] < 0 else 'the middle'}"
        for row in table
    ]
    for axes, title, key in zip(panels, PANELS, ("known_s", "error_deg", "found", "covered"), strict=True):
        for place, row in enumerate(table):
            mean = row[f"{key}_mean"]
            half = [[mean - row[f"{key}_low"]], [row[f"{key}_high"] - mean]]
            axes.errorbar([mean], [place], xerr=half, fmt="o", color="#1f5fa8", **ERROR_BARS)
            known = row["delay"] == STUDIES["sweeps-timing-known"]
            target = TARGETS.get((row["peak_snr_db"], known, row["start_deg"] < 0))
            if target is not None and key != "covered":
                axes.plot(
                    [target[PANELS.index(title)]] * 2, [place - 0.35, place + 0.35], color="#c8501e", linewidth=1.5
                )
        if key == "covered":
            axes.axvspan(93, 98, color="#c8501e", alpha=0.2, linewidth=0)
        axes.set(title=title)
        axes.title.set_fontsize(9)
        axes.grid(visible=True, linewidth=0.4)
    panels[0].set_yticks(range(len(names)), labels=names, fontsize=8)
    panels[0].invert_yaxis()
    save_figure(figure, PICTURE)


if __name__ == "__main__":
    main()
