"""Draws `figures/map.png`: the packages of markerseek in the layers of the import contract (`make figures`)."""

from __future__ import annotations

import tomllib
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parents[2]
PICTURE = Path(__file__).parent / "figures/map.png"

SHORT = {
    "cli": "one file a command",
    "studies": "many searches, one table; the paper",
    "bridges": "live page, ROS 2, 3D Slicer",
    "figures": "of a result, of a bank",
    "following": "the probe follows a target",
    "registration": "from spots in camera images to a transform: one session",
    "runs": "search, resume, bank scan",
    "emulators": "stage, laser box, SonixDAQ: their bytes; endoscope",
    "rigs": "puts a rig together",
    "show": "words, curves, figures, pages",
    "bmode": "B-mode images of files",
    "scan": "the loop: Scanner, run",
    "sim": "a simulated world",
    "drivers": "the real devices",
    "records": "journal, banks, exports",
    "supervisor": "stops laser and stage",
    "files": "files, settings, serial ports",
    "ros": "ROS 2: node, topics, messages",
    "guard": "limits, permits, admission",
    "wire": "protocols as bytes",
    "contract": "contract tests",
    "search": "the next angle",
    "signals": "frame to reading",
    "acoustics": "angle to sound",
    "calibration": "scan to constants",
    "geometry": "registration, stereo",
    "vision": "camera and B-mode images",
    "core": "values, protocols, events, errors",
}


PURE = {"core", "search", "signals", "acoustics", "calibration", "geometry", "vision", "guard", "wire"}
"""Packages that know no clock, file, socket or thread."""


def layers() -> list[list[str]]:
    """Packages by layer, from the top down, as the import contract names them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    named = next(contract["layers"] for contract in contracts if contract["type"] == "layers")
    rows = [[part.strip().removeprefix("markerseek.") for part in layer.split("|")] for layer in named]
    return [kept for row in rows if (kept := [name for name in row if not name.startswith("_")])]


def main() -> None:
    """Draw the picture."""
    rows = layers()
    figure = Figure(figsize=(12.5, 0.95 * len(rows) + 0.4), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(0, 12), ylim=(-len(rows), 0.25))
    axes.axis("off")
    for row, packages in enumerate(rows):
        width = 12 / len(packages)
        for place, package in enumerate(packages):
            pure = package in PURE
            box = FancyBboxPatch(
                (place * width + 0.06, -row - 0.86),
                width - 0.12,
                0.74,
                boxstyle="round,pad=0,rounding_size=0.08",
                facecolor="#e3edf8" if pure else "#f4f1ea",
                edgecolor="#7d8794",
                linewidth=0.8,
            )
            axes.add_patch(box)
            middle = (place + 0.5) * width
            axes.text(middle, -row - 0.38, package, ha="center", va="center", fontsize=10.5, fontweight="bold")
            axes.text(middle, -row - 0.63, SHORT[package], ha="center", va="center", fontsize=7.8)
    axes.text(
        0.06, 0.12, "imports point down only; blue packages are pure: no clock, file, socket or thread", fontsize=9
    )
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE, dpi=110)


if __name__ == "__main__":
    main()
