"""Make `simulated_scan.csv`: a scan of a simulated rig, as a table of angles and intensities.

Run it from the repository: ``python examples/make_simulated_scan.py``. The numbers are simulated.
"""

import csv
from pathlib import Path

from markerseek import rigs
from markerseek.search import equal_steps

rig = rigs.simulated(seed=7, marker_deg=-8.25)
with (Path(__file__).parent / "simulated_scan.csv").open("w", newline="") as file:
    rows = csv.writer(file)
    rows.writerow(("angle_deg", "intensity"))
    for angle_deg in equal_steps(limits=rig.limits.search, acquisitions=141):
        sample = rig.scanner.measure(angle_deg)
        rows.writerow((f"{angle_deg:.1f}", f"{sample.reading.intensity:.2f}"))
