"""SciPy's bounded minimiser (Brent's method between two bounds) as a policy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from markerseek.adapters.optimiser import OptimiserPolicy

TOLERANCE_DEG = 1e-3
"""Change of the angle at which it ends, in degrees."""


class _NotMeasuredError(Exception):
    """The minimiser evaluates an angle that has not been measured yet."""

    def __init__(self, angle_deg: float) -> None:
        super().__init__(angle_deg)
        self.angle_deg = angle_deg


class BoundedMinimiser(OptimiserPolicy):
    """`scipy.optimize.minimize_scalar(method="bounded")` on the negative intensity.

    Where the stage stops next to the requested angle, the minimiser uses the value as that of the requested angle.
    """

    name = "bounded-minimiser"
    summary = "SciPy's bounded minimiser (Brent) on the intensity"
    least = 1

    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        from scipy.optimize import minimize_scalar

        measured: Iterator[float] = iter(values)

        def negative_intensity(angle_deg: float) -> float:
            value = next(measured, None)
            if value is None:
                raise _NotMeasuredError(float(angle_deg))
            return -value

        # `minimize_scalar` runs its own loop. It is therefore restarted for each acquisition and replays the measured
        # values: the method draws nothing at random and takes microseconds, so that it requests the same angles again.
        try:
            minimize_scalar(
                negative_intensity,
                bounds=(self._limits.low_deg, self._limits.high_deg),
                method="bounded",
                options={"xatol": TOLERANCE_DEG, "maxiter": len(angles_deg) + 1},
            )
        except _NotMeasuredError as wanted:
            return wanted.angle_deg
        return None
