"""SciPy's bounded minimiser (Brent's method between two bounds) as a policy.

`scipy.optimize.minimize_scalar` owns its loop and calls the function. Here it is run again from its beginning for each
acquisition, on a function that returns the measured values and stops it at the first angle that has none: the method
draws nothing at random, so it asks for the same angles again, and a run costs microseconds beside an acquisition.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markerseek.adapters.optimiser import OptimiserPolicy
from markerseek.core import PAPER_RANGE, Interval

TOLERANCE_DEG = 1e-3
"""Change of the angle at which it ends, in degrees."""


class _Wanted(Exception):  # noqa: N818 - a message, no error
    """The minimiser wants a value that has not been measured."""

    def __init__(self, angle_deg: float) -> None:
        super().__init__(angle_deg)
        self.angle_deg = angle_deg


class BoundedMinimiser(OptimiserPolicy):
    """`scipy.optimize.minimize_scalar(method="bounded")` on the intensity, turned over.

    Where the stage stops beside the requested angle, the minimiser receives the value as that of the requested one.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    tolerance_deg
        Change of the angle at which it ends, in degrees.
    """

    name = "bounded-minimiser"
    least = 1

    def __init__(
        self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16, tolerance_deg: float = TOLERANCE_DEG
    ) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions)
        self._tolerance_deg = tolerance_deg

    def _propose(self, asked_deg: Sequence[float], values: Sequence[float]) -> float | None:
        from scipy.optimize import minimize_scalar

        known: Iterator[float] = iter(values)

        def turned_over(angle_deg: float) -> float:
            value = next(known, None)
            if value is None:
                raise _Wanted(float(angle_deg))
            return -value

        try:
            minimize_scalar(
                turned_over,
                bounds=(self._limits.low_deg, self._limits.high_deg),
                method="bounded",
                options={"xatol": self._tolerance_deg, "maxiter": len(asked_deg) + 1},
            )
        except _Wanted as wanted:
            return wanted.angle_deg
        return None
