"""markerseek finds a photoacoustic marker with a motorised transrectal ultrasound probe, by itself.

The names here are all that most users need::

    import markerseek

    rig = markerseek.simulated(seed=1)
    policy = markerseek.build("weighted-average", limits=rig.limits.search)
    for event in markerseek.run(policy, rig.scanner, dark_frames=rig.dark_frames):
        print(event)

Each is imported when it is first used: `simulated` and `replayed` bring NumPy, SciPy and Numba with them.
"""

from typing import TYPE_CHECKING

from markerseek._version import __version__

if TYPE_CHECKING:
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
    from markerseek.rigs import replayed, simulated
    from markerseek.scan import run
    from markerseek.search import build

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

_PACKAGES = {"build": "search", "replayed": "rigs", "run": "scan", "simulated": "rigs"}
"""Packages of the names that are not of `markerseek.core`."""


def __getattr__(name: str) -> object:
    """One of the public names, imported at its first use (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module 'markerseek' has no attribute {name!r}")
    from importlib import import_module

    value: object = getattr(import_module(f"markerseek.{_PACKAGES.get(name, 'core')}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All names, also of what was not imported yet."""
    return sorted({*globals(), *__all__})
