"""Let simulated rigs follow markers by ``markerseek track``, and print the second table of ``tracking.md``."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

DIRECT = (Path(__file__).parents[2] / "examples" / "rigs" / "direct-drive.toml").read_text(encoding="utf-8")
FAST_RECEIVER = 'kind = "simulated"\n[laser]\npulses = 4\n[receiver]\nreadout_s = 0.02\n'
RIGS = {
    "PRM1Z8 as it is driven, 10°/s and 10°/s²": FAST_RECEIVER,
    "its limits, 25°/s and 25°/s²": f"{FAST_RECEIVER}[stage]\nspeed_deg_s = 25.0\nacceleration_deg_s2 = 25.0\n",
    "direct drive, 360°/s and 5,000°/s²": DIRECT,
}
SPEEDS_DEG_S, SEEDS = (1, 5, 10), range(1, 6)


def row(rig: Path, name: str, speed_deg_s: int) -> str:
    """One row of the table: the runs of one rig and speed."""
    runs = []
    for seed in SEEDS:
        words = ["track", "--rig", str(rig), "--speed-deg-per-s", str(speed_deg_s), "--seed", str(seed), "--json"]
        # The words are those above.
        ended = subprocess.run(  # noqa: S603
            [sys.executable, "-m", "markerseek", *words], capture_output=True, check=False
        )
        runs.append(json.loads(ended.stdout))
    lost = sum(run["lost"] for run in runs)
    rates = [run["frames_per_s"] for run in runs if run["frames_per_s"] is not None]
    rate = f"{np.mean(rates):.1f} a second" if rates else "lost after one"
    # The error and lag of a marker that was lost say nothing.
    numbers = "– | – | –"
    if lost < len(runs) / 2:
        rms_deg = np.sqrt(np.mean([run["rms_error_deg"] ** 2 for run in runs]))
        within, lag_s = (np.mean([run[key] for run in runs]) for key in ("within_1_deg", "lag_s"))
        numbers = f"{rms_deg:.2f}° | {within:.0%} | {lag_s:.2f} s"
    return f"| {name} | {speed_deg_s}°/s | {rate} | {numbers} | {lost} of {len(runs)} |"


def main() -> None:
    """Print the table, row by row."""
    sys.stdout.write("| stage | marker | frames | RMS error | within 1° | lag | lost |\n" + 7 * "|---" + "|\n")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in RIGS.items():
            rig = Path(folder) / "rig.toml"
            rig.write_text(text, encoding="utf-8")
            for speed_deg_s in SPEEDS_DEG_S:
                sys.stdout.write(f"{row(rig, name, speed_deg_s)}\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
