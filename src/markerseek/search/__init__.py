"""Search policies (ask and tell): `ask` returns the next angle, `tell` takes the sample measured there. No I/O.

Each method exists as published, which always answers, and as a `CheckedPolicy`, whose answer must pass tests. `build`
makes either of them from the method's name.
"""

from markerseek.search.bracket import GOLDEN, TERNARY, BracketSearch
from markerseek.search.checked import CheckedPolicy
from markerseek.search.curve import Curve, Peak, curve_of, peak_of
from markerseek.search.floor import noise_factor, noise_of
from markerseek.search.manual import ScriptedManual
from markerseek.search.methods import (
    METHODS,
    Method,
    MethodName,
    build,
    build_sweeping,
    is_own_method,
    method_named,
    most_acquisitions,
    of_all_angles,
    posterior_of_all,
    refuse_posterior_settings,
    require_plan,
    require_sweeping,
)
from markerseek.search.policy import SearchPolicy, check_acquisitions
from markerseek.search.recording import WholeRecording
from markerseek.search.steps import THRESHOLD, Exhaustive, WeightedAverage, equal_steps, peak_passed, weighted_average

__all__ = [
    "GOLDEN",
    "METHODS",
    "TERNARY",
    "THRESHOLD",
    "BracketSearch",
    "CheckedPolicy",
    "Curve",
    "Exhaustive",
    "Method",
    "MethodName",
    "Peak",
    "ScriptedManual",
    "SearchPolicy",
    "WeightedAverage",
    "WholeRecording",
    "build",
    "build_sweeping",
    "check_acquisitions",
    "curve_of",
    "equal_steps",
    "is_own_method",
    "method_named",
    "most_acquisitions",
    "noise_factor",
    "noise_of",
    "of_all_angles",
    "peak_of",
    "peak_passed",
    "posterior_of_all",
    "refuse_posterior_settings",
    "require_plan",
    "require_sweeping",
    "weighted_average",
]
