"""Registration without each of its points in turn, to see which one does not fit the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from markerseek.core import Bool, ConfigError, Float64
from markerseek.geometry.registration import Registration


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeaveOneOut:
    """A registration without one point."""

    error_m: float
    """Distance of that point from where the others put it."""
    rest: Registration
    """The registration of the others."""


def leave_one_out(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    register: Callable[[Bool[np.ndarray, " points"]], Registration],
) -> list[LeaveOneOut | None]:
    """The registration without each point; None where the others do not determine one."""
    found: list[LeaveOneOut | None] = []
    for number in range(len(source_m)):
        try:
            rest = register(np.arange(len(source_m)) != number)
        except ConfigError:
            # The others are too few, or lie on a line.
            found.append(None)
            continue
        error_m = float(np.linalg.norm(rest.transform.apply(source_m[number]) - target_m[number]))
        found.append(LeaveOneOut(error_m=error_m, rest=rest))
    return found
