"""Lower bounds on the error of the marker's angle: Cramér and Rao's, with and without a prior (Van Trees). Pure."""

from benchmarks.bounds.best_angles import BestAngles, best_angles
from benchmarks.bounds.information import (
    NUISANCES,
    TABLE_PRIOR,
    IntensityNoise,
    Nuisance,
    Prior,
    SampledCurve,
    SlopedCurve,
    angle_bound_deg,
    sample_information,
)

__all__ = [
    "NUISANCES",
    "TABLE_PRIOR",
    "BestAngles",
    "IntensityNoise",
    "Nuisance",
    "Prior",
    "SampledCurve",
    "SlopedCurve",
    "angle_bound_deg",
    "best_angles",
    "sample_information",
]
