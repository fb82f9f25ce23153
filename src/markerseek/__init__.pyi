from ._version import __version__
from .core import (
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
    RunPlan,
    Sample,
    SearchPlan,
    Unsure,
)
from .figures import bank_figure, search_figure
from .rigs import replayed, simulated
from .runs import find_marker
from .scan import run
from .search import build

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
    "RunPlan",
    "Sample",
    "SearchPlan",
    "Unsure",
    "__version__",
    "bank_figure",
    "build",
    "find_marker",
    "replayed",
    "run",
    "search_figure",
    "simulated",
]
