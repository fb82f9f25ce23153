"""Registration without each of its points in turn, to see which one does not fit the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64
from markerseek.geometry.registration import register_points


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaveOneOut:
    """A registration without one point.

    Attributes
    ----------
    error_m
        Distance of that point from where the others put it, in metres.
    fre_m
        Fiducial registration error of the others, in metres.
    """

    error_m: float
    fre_m: float


def leave_one_out(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    *,
    source_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
    target_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
) -> list[LeaveOneOut | None]:
    """The registration without each point; None where the others do not determine one.

    Parameters
    ----------
    source_m, target_m, source_covariances_m2, target_covariances_m2
        As in `register_points`.
    """
    found: list[LeaveOneOut | None] = []
    for number in range(len(source_m)):
        others = np.arange(len(source_m)) != number
        try:
            rest = register_points(
                source_m[others],
                target_m[others],
                source_covariances_m2=None if source_covariances_m2 is None else source_covariances_m2[others],
                target_covariances_m2=None if target_covariances_m2 is None else target_covariances_m2[others],
            )
        except ConfigError:
            # The others are too few, or lie on a line.
            found.append(None)
            continue
        error_m = float(np.linalg.norm(rest.transform.apply(source_m[number]) - target_m[number]))
        found.append(LeaveOneOut(error_m=error_m, fre_m=rest.fre_m))
    return found
