"""Assembles rigs and reads rig files; runs on a rig are in `markerseek.runs`.

`simulated` makes a rig of a simulated world, `of_intensities` one of its intensity curve alone, `replayed` one of a
recorded scan, and `bench` one of real devices. All have the same `Scanner`. Each is imported at its first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
