"""markerseek finds a photoacoustic marker with a motorised transrectal ultrasound probe, by itself.

The names here are all that most users need::

    import markerseek

    rig = markerseek.simulated(seed=1)
    policy = markerseek.build("weighted-average", limits=rig.limits.search)
    for event in markerseek.run(policy, rig.scanner, dark_frames=rig.dark_frames):
        print(event)

`simulated` and `replayed` bring the imaging chain with them, and are imported when they are first used.
"""

from typing import TYPE_CHECKING

from markerseek._version import __version__
from markerseek.core import (
    Ambiguous,
    AtBound,
    Finished,
    Found,
    Interval,
    MarkerseekError,
    Measured,
    NotFound,
    Policy,
    Reading,
    Sample,
    Unsure,
)
from markerseek.scan import run
from markerseek.search import build

if TYPE_CHECKING:
    from markerseek.rigs import replayed, simulated

__all__ = [
    "Ambiguous",
    "AtBound",
    "Finished",
    "Found",
    "Interval",
    "MarkerseekError",
    "Measured",
    "NotFound",
    "Policy",
    "Reading",
    "Sample",
    "Unsure",
    "__version__",
    "build",
    "replayed",
    "run",
    "simulated",
]


def __getattr__(name: str) -> object:
    """The two names that are imported late."""
    if name in ("replayed", "simulated"):
        from markerseek import rigs

        return getattr(rigs, name)
    raise AttributeError(f"module 'markerseek' has no attribute {name!r}")
