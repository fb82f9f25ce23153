"""Which width and noise of simulated intensity curves give the Fig. 5 nearest to the paper's.

``python docs/validation/measure_consistency.py`` (a minute): eight widths, six noises, 60 markers each. The nearest
is `markerseek.studies.paper.fig5.FITTED`.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from markerseek.studies.paper.fig5 import Condition, Marker, searches_for
from markerseek.studies.paper.section import printed_value

RADII_M = (0.15e-3, 0.3e-3, 0.35e-3, 0.4e-3, 0.45e-3, 0.5e-3, 0.8e-3, 1.2e-3)
"""Radii of the absorber, which set the widths: from the default to half the stained patch of 5 mm at its waist."""

LEVELS_DB = (20.0, 30.0, 40.0, 50.0, 60.0, 80.0)
"""Peak SNR."""

SWEEPS = (8, 12, 16, 22, 28)
"""N of WA over which its mean error is averaged here; Fig. 5 has all from 8 to 28."""

RUNS = (("TS", (28,)), ("GSS", (28,)), *(("WA", (count,)) for count in SWEEPS))
"""Searches for each marker, with their acquisitions."""

MARKERS, SEED = 60, 1


def errors_deg(condition: Condition) -> dict[str, float]:
    """Mean error of each method."""
    found = [each for trial in range(MARKERS) for each in searches_for(Marker(condition, SEED, trial, RUNS))]
    return {
        name: float(np.mean([each.error_deg(max(each.answers_deg)) for each in found if each.method == name]))
        for name in ("WA", "TS", "GSS")
    }


def misfit(errors: dict[str, float]) -> float:
    """Sum of the squared logarithms of ours over the paper's."""
    # An error may be 0 with little noise, and has no logarithm then.
    return sum(math.log(max(error, 1e-6) / printed_value(f"fig5/{name}")) ** 2 for name, error in errors.items())


def main() -> None:
    """Search, and print the table with the nearest first."""
    rows = []
    for radius_m in RADII_M:
        for level_db in LEVELS_DB:
            condition = Condition(source_radius_m=radius_m, peak_snr_db=level_db)
            errors = errors_deg(condition)
            rows.append((misfit(errors), condition.words, errors))
    for apart, words, errors in sorted(rows, key=lambda row: row[0]):
        sys.stdout.write(f"{apart:8.3f}  {words:24}  {errors}\n")


if __name__ == "__main__":
    main()
