"""Search in simulated tables of angles and intensities, and print the figures of "Recorded scans" in ``answers.md``.

``python docs/validation/measure_recordings.py clean 200``: scans of 15 to 141 angles, one row each kind of answer.
``python docs/validation/measure_recordings.py units 200``: the same scan in degrees, radians and milliradians.
``python docs/validation/measure_recordings.py nothing 200``: tables of noise alone.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek import find_marker, replayed
from markerseek.core import SearchPlan
from markerseek.records.banks.table import AngleUnit

SEED = 20261126
UNITS: dict[AngleUnit, tuple[float, int]] = {"deg": (1.0, 6), "rad": (np.pi / 180, 8), "mrad": (np.pi / 0.18, 5)}
"""Size of a degree in each unit, and how many places of it stand in a table."""
SAMPLE_ERROR, NOISE = 0.03, 0.01
AGREE_DEG, JITTER_DEG = 0.02, 0.001


@dataclass(frozen=True)
class Answer:
    """An answer as it is printed."""

    name: str
    angle_deg: float
    interval_deg: tuple[float, float] | None


def drawn(number: int, *, marker: bool = True) -> tuple[float, np.ndarray, np.ndarray]:
    """The true angle of a scan, its angles in degrees and its intensities."""
    rng = np.random.Generator(np.random.PCG64([SEED, number]))
    while True:
        step_deg, count = rng.uniform(1.0, 5.0), int(rng.integers(15, 142))
        if step_deg * (count - 1) <= 140.0:
            break
    angles_deg = np.round((np.arange(count) - (count - 1) / 2) * step_deg, 3)
    width_deg = rng.uniform(4.0, 16.0)
    inside_deg = min(30.0, 0.8 * angles_deg[-1])
    true_deg = rng.uniform(-inside_deg, inside_deg)
    curve = np.exp(-4 * np.log(2) * ((angles_deg - true_deg) / width_deg) ** 2) if marker else np.zeros(count)
    intensities = np.abs(curve * (1 + SAMPLE_ERROR * rng.normal(size=count)) + NOISE * rng.normal(size=count))
    return true_deg, angles_deg, 1000 * intensities


def searched(folder: Path, angles_deg: np.ndarray, intensities: np.ndarray, unit: AngleUnit = "deg") -> list[Answer]:
    """The answer of the search, and the answer from all angles."""
    scale, places = UNITS[unit]
    table = folder / "scan.csv"
    rows = zip(angles_deg * scale, intensities, strict=True)
    table.write_text("\n".join([f"angle_{unit},intensity", *(f"{a:.{places}f},{v:.6f}" for a, v in rows)]))
    every = find_marker(replayed(table), SearchPlan(method="posterior", acquisitions=angles_deg.size))
    search = every.search
    if search is None:
        raise SystemExit(f"{table}: there is no search to compare")
    return [Answer(each.answer, each.angle_deg, each.interval95_deg) for each in (search, every)]


def single(folder: Path, count: int, *, marker: bool) -> None:
    """One answer of each kind for each scan."""
    names: tuple[Counter[str], Counter[str]] = (Counter(), Counter())
    covered, errors_deg = [0, 0], ([], [])
    for number in range(count):
        true_deg, angles_deg, intensities = drawn(number, marker=marker)
        for kind, answer in enumerate(searched(folder, angles_deg, intensities)):
            names[kind][answer.name] += 1
            if answer.interval_deg is not None:
                covered[kind] += answer.interval_deg[0] <= true_deg <= answer.interval_deg[1]
                errors_deg[kind].append(abs(answer.angle_deg - true_deg))
    for kind, name in enumerate(("the search", "all angles")):
        sys.stdout.write(f"{name}: {dict(names[kind])}\n")
        if marker:
            mean_deg, most_deg = np.mean(errors_deg[kind]), np.max(errors_deg[kind])
            sys.stdout.write(
                f"  {covered[kind]} of {len(errors_deg[kind])} covered, off by {mean_deg:.3f}, at most {most_deg:.2f}\n"
            )


def in_units(folder: Path, count: int, *, jitter_deg: float) -> None:
    """The same scan in three units, each with its own jitter of the angles."""
    same, agree, most_deg = [0, 0], [0, 0], [0.0, 0.0]
    for number in range(count):
        _, angles_deg, intensities = drawn(number)
        rng = np.random.Generator(np.random.PCG64([SEED, number, 1]))
        answers = [
            searched(folder, angles_deg + jitter_deg * rng.normal(size=angles_deg.size), intensities, unit)
            for unit in UNITS
        ]
        for kind, each in enumerate(zip(*answers, strict=True)):
            spread_deg = float(np.ptp([answer.angle_deg for answer in each]))
            same[kind] += len({answer.name for answer in each}) == 1
            agree[kind] += spread_deg <= AGREE_DEG
            most_deg[kind] = max(most_deg[kind], spread_deg)
    for kind, name in enumerate(("the search", "all angles")):
        sys.stdout.write(
            f"{name}, jitter {jitter_deg:g} deg: same answer {same[kind]} of {count}, within {AGREE_DEG} deg "
            f"{agree[kind]} of {count}, {most_deg[kind]:.3f} deg at most\n"
        )


def main() -> None:
    """Print the figures of one kind of scan."""
    kind, count = sys.argv[1], int(sys.argv[2])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if kind == "units":
            for jitter_deg in (0.0, JITTER_DEG):
                in_units(folder, count, jitter_deg=jitter_deg)
        else:
            single(folder, count, marker={"clean": True, "nothing": False}[kind])


if __name__ == "__main__":
    main()
