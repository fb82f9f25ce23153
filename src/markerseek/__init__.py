"""markerseek finds a photoacoustic marker with a motorised transrectal ultrasound probe, by itself.

The names here are all that most users need::

    import markerseek

    rig = markerseek.simulated(seed=1)
    policy = markerseek.build("weighted-average", limits=rig.limits.search)
    for event in markerseek.run(policy, rig.scanner, rig.run_plan):
        print(event)

Each is imported when it is first used: `simulated` and `replayed` bring NumPy, SciPy and Numba with them.
"""

import lazy_loader

from markerseek._version import __version__ as __version__

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
