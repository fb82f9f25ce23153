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

        run(COMMAND, "replay", EXAMPLES / "simulated_scan.csv", "--plot", "--out", folder)
        run(COMMAND, "study", EXAMPLES / "studies" / "own-policy.toml", "--plot", "--out", folder / "study")
        run(sys.executable, EXAMPLES / "simulated_tip.py", folder / "tip")
        run(COMMAND, "tooltip", folder / "tip", "--pixel-mm", "0.15", "--plot", "--out", folder)
        made = {"replay.png": "replay.png", "study/error.png": "own-policy.png", "tip-tip.png": "tip.png"}
        for source, to in made.items():
            shutil.copyfile(folder / source, HERE / to)


if __name__ == "__main__":
    main()
