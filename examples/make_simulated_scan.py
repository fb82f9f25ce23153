"""Make `simulated_scan.csv` and `two_sources.csv`: scans of a simulated rig, as tables of angles and intensities.

Run it from the repository: ``python examples/make_simulated_scan.py``. The numbers are simulated.
"""

import csv
from pathlib import Path

from markerseek import rigs
from markerseek.search import equal_steps


def write(name, rig, acquisitions):
    """Write the intensities of a scan in equal steps over the search range."""
    with (Path(__file__).parent / name).open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("angle_deg", "intensity"))
        for angle_deg in equal_steps(limits=rig.limits.search, acquisitions=acquisitions):
            sample = rig.scanner.measure(angle_deg)
            rows.writerow((f"{angle_deg:.1f}", f"{sample.reading.intensity:.2f}"))


write("simulated_scan.csv", rigs.simulated(seed=7, marker_deg=-8.25), 141)
write("two_sources.csv", rigs.simulated(seed=7, marker_deg=-8.25, second_marker_deg=6.5), 71)
