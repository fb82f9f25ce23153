"""Lower bounds on the error of the marker's angle: Cramér–Rao, Van Trees, Ziv–Zakai. Pure."""

from markerseek.search.bounds.best_angles import BestAngles, best_angles
from markerseek.search.bounds.curves import SampledCurve, SlopedCurve
from markerseek.search.bounds.information import (
    NUISANCES,
    TABLE_PRIOR,
    Nuisance,
    ObservationNoise,
    Prior,
    angle_bound_deg,
    sample_information,
)
from markerseek.search.bounds.ziv_zakai import ziv_zakai_deg

__all__ = [
    "NUISANCES",
    "TABLE_PRIOR",
    "BestAngles",
    "Nuisance",
    "ObservationNoise",
    "Prior",
    "SampledCurve",
    "SlopedCurve",
    "angle_bound_deg",
    "best_angles",
    "sample_information",
    "ziv_zakai_deg",
]
