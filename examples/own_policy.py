"""A policy of one's own: even steps, then the centre of mass of the strong half.

In the folder of this file, ``markerseek search --method own_policy:CentreOfMass`` searches with it.
"""

import numpy as np

from markerseek.core import Estimate, Found, Interval, NotFound
from markerseek.search import SearchPolicy, check_acquisitions, equal_steps, noise_of


class CentreOfMass(SearchPolicy):
    """Sweeps the range, and answers with the centre of mass of the samples above half of the largest."""

    name = "centre of mass"
    acquisitions = 16

    def __init__(self, *, limits: Interval, acquisitions: int) -> None:
        super().__init__()
        check_acquisitions(acquisitions, least=2, method=self.name)
        self._limits = limits
        self._angles_deg = equal_steps(limits, acquisitions=acquisitions)

    def _next_deg(self) -> float | None:
        """Next angle in degrees; None at the end."""
        return float(self._angles_deg[len(self._lit)]) if len(self._lit) < len(self._angles_deg) else None

    def estimate(self) -> Estimate:
        """Answer now; allowed before the first sample."""
        noise = noise_of(self._lit, dark=self._dark)
        largest = max((sample.reading.intensity for sample in self._lit), default=0.0)
        if noise.floor.level is None or not largest > noise.floor.level:
            return NotFound(
                mean_deg=self._limits.centre_deg, reason="nothing exceeds the detection threshold", floor=noise.floor
            )
        strong = [sample for sample in self._lit if sample.reading.intensity >= largest / 2]
        weights = [sample.reading.intensity for sample in strong]
        mean_deg = float(np.average([sample.angle_deg for sample in strong], weights=weights))
        # A step divided by sqrt(12): the standard deviation of a position that is known to within one step.
        sigma_deg = self._limits.width_deg / (len(self._angles_deg) - 1) / np.sqrt(12)
        return Found(
            mean_deg=mean_deg,
            sigma_deg=sigma_deg,
            interval95_deg=Interval(low_deg=mean_deg - 2 * sigma_deg, high_deg=mean_deg + 2 * sigma_deg),
            interval_kind="propagated",
            floor=noise.floor,
        )
