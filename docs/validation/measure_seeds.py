"""Runs the registration of a tutorial with many seeds, by sweeps and with the receiver of the paper, one row a session.

``python docs/validation/measure_seeds.py 30`` adds the sessions that docs/data/registration-seeds.csv does not have,
and prints the middle and the spread of all. A session takes 20 to 60 s of a computer.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

FILE = Path(__file__).parents[1] / "data" / "registration-seeds.csv"

RECEIVERS = {"streams, sweeps": ("--sweep",), "reads for 10 s, stops": ()}
"""Receivers of the simulated rig, each with its options of ``register``."""

PERSON_S = 10.0
"""Assumed time that a person needs to set a spot, in seconds: nobody has measured it."""

COLUMNS = ("receiver", "seed", "registered", "goal_reached", "markers", "rig_s", "tre_m", "tre95_m", "true_error_m")


def _rounded(value: float | None) -> float | str:
    return "" if value is None else round(value, 6)


def session(receiver: str, seed: int, folder: Path) -> dict[str, object]:
    """Run one session by the command, and return its row."""
    words = ("register", "--simulate", *RECEIVERS[receiver], "--seed", str(seed), "--no-frames", "--json")
    command = (sys.executable, "-P", "-m", "markerseek", *words, "--record", str(folder))
    ended = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  our own words
    if ended.returncode not in (0, 3):
        sys.exit(ended.stderr)
    told = json.loads(ended.stdout)
    return {
        "receiver": receiver,
        "seed": seed,
        "registered": told["decided"],
        "goal_reached": told["goal_reached"],
        "markers": len(told["simulation"]["marker_errors_m"]),
        "rig_s": round(told["rig_s"], 1),
        "tre_m": _rounded(told["tre_m"]),
        "tre95_m": _rounded(told["tre95_m"]),
        # A session that is not registered has no transform, and so no error.
        "true_error_m": _rounded(told["simulation"]["target_error_m"]),
    }


def rows() -> list[dict[str, str]]:
    """Return the sessions so far."""
    if not FILE.exists():
        return []
    with FILE.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _values(chosen: Sequence[dict[str, str]], column: str, scale: float = 1.0) -> np.ndarray:
    return scale * np.array([float(row[column]) for row in chosen])


def _spread(values: np.ndarray, digits: int) -> str:
    """The median of values, and where the middle nine tenths of them lie."""
    low, middle, high = np.percentile(values, (5, 50, 95))
    return f"{middle:.{digits}f} ({low:.{digits}f}–{high:.{digits}f})"


def table() -> str:
    """Return a table in Markdown, with a row for each receiver."""
    heads = (
        "receiver",
        "sessions",
        "registered",
        "markers",
        "rig, s",
        "with a person, min",
        "expected TRE, mm",
        "true, mm",
    )
    lines = [f"| {' | '.join(heads)} | true below 95 % length |", "|---|---|---|---|---|---|---|---|---|"]
    for receiver in RECEIVERS:
        chosen = [row for row in rows() if row["receiver"] == receiver]
        if not chosen:
            continue
        markers = _values(chosen, "markers")
        rig_s = _values(chosen, "rig_s")
        known = [row for row in chosen if row["true_error_m"]]
        true_mm = _values(known, "true_error_m", 1e3)
        cells = (
            receiver,
            str(len(chosen)),
            str(sum(row["registered"] == "True" for row in chosen)),
            _spread(markers, 0),
            _spread(rig_s, 0),
            _spread((rig_s + PERSON_S * markers) / 60, 1),
            _spread(_values(known, "tre_m", 1e3), 2),
            _spread(true_mm, 2),
            f"{np.sum(true_mm <= _values(known, 'tre95_m', 1e3))} of {len(known)}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Run the missing sessions, and print the table."""
    known = {(row["receiver"], int(row["seed"])) for row in rows()}
    missing = [
        (receiver, seed)
        for seed in range(1, 1 + int(sys.argv[1]))
        for receiver in RECEIVERS
        if (receiver, seed) not in known
    ]
    for receiver, seed in missing:
        with tempfile.TemporaryDirectory() as name:
            row = session(receiver, seed, Path(name) / "session")
        with FILE.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(row)
    sys.stdout.write(table() + "\n")


if __name__ == "__main__":
    main()
