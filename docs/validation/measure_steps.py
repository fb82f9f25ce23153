"""Answers from all angles of simulated scans, over the step, the noise and the laser: ``record-a-good-scan.md``.

``python docs/validation/measure_steps.py 16``: so many markers, each scanned in steps of 0.5 degrees, of which longer
steps are parts. The laser's energy is put into the intensities of the scans in steps of one degree.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

import markerseek
from markerseek.search import equal_steps

SEED = 20261128
STEPS_DEG = (0.5, 1.0, 2.0, 3.5, 5.0)
ENERGY_SPREAD, METER = 0.1, 0.01


def scanned(number: int, snr_db: float) -> tuple[float, np.ndarray, np.ndarray]:
    """The true angle of a scan, its angles in degrees and its intensities."""
    rig = markerseek.simulated(seed=SEED + number, snr_db=snr_db)
    angles_deg = np.array(list(equal_steps(limits=rig.limits.search, acquisitions=141)))
    intensities = [rig.scanner.measure(float(angle)).reading.intensity for angle in angles_deg]
    return float(rig.facts.truth_deg or 0.0), angles_deg, np.array(intensities)


def judged(name: str, tables: list[tuple[float, np.ndarray]]) -> None:
    """Print what the answers to tables of angle, intensity and, if measured, energy have in common."""
    answers: Counter[str] = Counter()
    errors_deg, halves_deg, covered = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.csv"
        for true_deg, rows in tables:
            head = ",".join(("angle_deg", "intensity", "energy")[: rows.shape[1]])
            np.savetxt(path, rows, delimiter=",", header=head, comments="", fmt="%.4f")
            result = markerseek.find_marker(markerseek.replayed(path))
            answers[result.answer] += 1
            if result.answer == "found":
                low_deg, high_deg = result.interval95_deg
                errors_deg.append(abs(result.angle_deg - true_deg))
                halves_deg.append((high_deg - low_deg) / 2)
                covered += low_deg <= true_deg <= high_deg
    mean = f"{np.mean(errors_deg):.3f}, at most {np.max(errors_deg):.2f}" if errors_deg else "-"
    half = f"{np.mean(halves_deg):.2f}" if halves_deg else "-"
    sys.stdout.write(f"{name}: {dict(answers)}; off by {mean} deg; ± {half} deg (95 %); {covered} covered\n")
    sys.stdout.flush()


def main() -> None:
    """Print a row for each kind of scan."""
    count = int(sys.argv[1])
    for snr_db in (40.0, 30.0):
        scans = [scanned(number, snr_db) for number in range(count)]
        for step_deg in STEPS_DEG:
            every = round(step_deg / 0.5)
            tables = [(true, np.column_stack([a, v])[::every]) for true, a, v in scans]
            judged(f"{snr_db:g} dB, {step_deg:g} deg", tables)
        if snr_db < 40.0:
            continue
        rng = np.random.Generator(np.random.PCG64(SEED))
        for metered in (False, True):
            tables = []
            for true, a, v in scans:
                energy = np.exp(ENERGY_SPREAD * rng.standard_normal(a.size))
                columns = [a, v * energy]
                if metered:
                    columns.append(energy * (1 + METER * rng.standard_normal(a.size)))
                tables.append((true, np.column_stack(columns)[::2]))
            judged(f"{snr_db:g} dB, 1 deg, energy varies by 10 %, {'' if metered else 'not '}recorded", tables)


if __name__ == "__main__":
    main()
