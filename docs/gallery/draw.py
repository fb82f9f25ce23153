"""Draws the pictures of the gallery: `make figures`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
COMMAND = Path(sys.executable).with_name("markerseek")


def main() -> None:
    """Run the examples, and keep their pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder, environment = Path(name), os.environ | {"PYTHONPATH": str(EXAMPLES)}

        def run(*words: str | Path) -> None:
            subprocess.run(words, env=environment, stdout=subprocess.DEVNULL, check=True)  # noqa: S603  our own words

        def replay(scan: str) -> Path:
            answered = (COMMAND, "replay", EXAMPLES / scan, "--plot", "--out", folder / scan)
            # Any answer but found ends with 3.
            ended = subprocess.run(answered, stdout=subprocess.DEVNULL, check=False)  # noqa: S603  our own words
            if ended.returncode not in (0, 3):
                sys.exit(f"replay {scan} ended with {ended.returncode}")
            return folder / scan / "replay.png"

        sweep = ("--rig", EXAMPLES / "rigs" / "sweep.toml", "--seed", "1", "--no-journal")
        run(COMMAND, "search", "--sweep", *sweep, "--plot", "--out", folder / "sweep.png")
        run(COMMAND, "study", EXAMPLES / "studies" / "own-policy.toml", "--plot", "--out", folder / "study")
        run(sys.executable, EXAMPLES / "simulated_tip.py", folder / "tip")
        run(COMMAND, "tooltip", folder / "tip", "--pixel-mm", "0.15", "--plot", "--out", folder)
        made = {
            folder / "sweep.png": "sweep.png",
            replay("simulated_scan.csv"): "replay.png",
            replay("two_sources.csv"): "two-sources.png",
            folder / "study" / "error.png": "own-policy.png",
            folder / "tip-tip.png": "tip.png",
        }
        for source, to in made.items():
            shutil.copyfile(source, HERE / to)


if __name__ == "__main__":
    main()
