"""Puts the parts of a rig together, and reads rig files; what happens on a rig over time is in `markerseek.runs`.

`simulated` makes a rig of a simulated world, `of_intensities` one of its intensity curve alone, `replayed` one of a
recorded scan, and `markerseek.rigs.bench.bench` one of real devices, imported when it is used. All run under the same
`Scanner`.
"""

from markerseek.rigs.replay import replayed
from markerseek.rigs.rig import Rig
from markerseek.rigs.simulation import USUAL_CELLS, of_intensities, simulated

__all__ = ["USUAL_CELLS", "Rig", "of_intensities", "replayed", "simulated"]
