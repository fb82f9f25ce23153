"""Search for simulated spots of another make than those of the tissues, and print the table of ``answers.md``.

``python docs/validation/measure_spots.py 300``: so many searches for each spot.
"""

from __future__ import annotations

import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np

from markerseek.acoustics import Clutter, GaussianAbsorber
from markerseek.sim import TISSUES, SimulatedSettings, StainedSpot, Tissue
from markerseek.studies import Axis, PolicySummary, Share, Study, read_rows, run_study, study_policy

SEED = 20261126
FINE, COARSE = GaussianAbsorber(radius_m=0.08e-3), GaussianAbsorber(radius_m=0.2e-3)
SPOTS = {
    "5 grains, 1 mm wide": StainedSpot(count=5, radius_m=0.5e-3, depth_m=0.5e-3, grain=FINE),
    "400 grains, 2 mm wide": StainedSpot(count=400, radius_m=1e-3, depth_m=0.5e-3, grain=FINE),
    "150 grains, 3 mm wide": StainedSpot(count=150, radius_m=1.5e-3, depth_m=0.5e-3, grain=FINE),
    "40 coarse grains, 1.6 mm wide and 1.5 mm deep": StainedSpot(
        count=40, radius_m=0.8e-3, depth_m=1.5e-3, grain=COARSE
    ),
    "60 grains, a patch of 5 mm": StainedSpot(count=60, radius_m=2.5e-3, depth_m=0.5e-3, grain=FINE),
}
AROUND = Clutter(count=8, strength=0.02, nearest_m=58e-3, farthest_m=75e-3, half_length_m=25e-3)

# Here, not in `main`: the processes that search import this file.
TISSUES.update({name: Tissue(description=name, spot=spot, clutter=AROUND) for name, spot in SPOTS.items()})


def line(of: PolicySummary, errors_deg: list[float]) -> str:
    """One row of the table: a spot, and the errors of its searches that found."""
    return (
        f"| {of.settings['rig.tissue']} | {percent(of.answers['found'])} "
        f"| {np.mean(errors_deg):.2f}°; {np.max(errors_deg):.2f}° | {percent(of.covered)} of {of.covered.count} "
        f"| {of.wrong_claims.hits} | {of.acquisitions.mean:.1f} |\n"
    )


def percent(share: Share) -> str:
    """A share with its 95 % limits."""
    low, high = share.interval95 or (0.0, 1.0)
    return f"{100 * (share.share or 0.0):.1f} % ({100 * low:.1f}–{100 * high:.1f})"


def main() -> None:
    """Search, and print the table."""
    study = Study(
        name="spots",
        seed=SEED,
        trials=int(sys.argv[1]),
        level="frames",
        drawn="everything",
        policies=(study_policy(method="posterior"),),
        rig=SimulatedSettings(start_deg=-35.0),
        vary=(Axis(key="rig.tissue", values=tuple(SPOTS)),),
    )
    with tempfile.TemporaryDirectory() as folder:
        finished = run_study(study, Path(folder))
        found: defaultdict[int, list[float]] = defaultdict(list)
        for row in read_rows(finished.rows, study):
            if row.answer == "found" and row.error_deg is not None:
                found[row.cell].append(row.error_deg)
    sys.stdout.write(
        "| spot | `Found` | mean error of these; largest | interval covers | > 2 tolerances | acquisitions |\n"
        "|---|---|---|---|---|---|\n"
    )
    sys.stdout.writelines(line(of, found[of.cell]) for of in finished.summary.policies)


if __name__ == "__main__":
    main()
