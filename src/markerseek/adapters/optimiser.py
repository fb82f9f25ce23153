"""What all adapters share: the strongest sample is the answer, and another package chooses the next angle."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence

from markerseek.core import PAPER_RANGE, Found, Interval
from markerseek.search.policy import SearchPolicy, check_acquisitions

CLEARLY_WEAKER = 3.0
"""Standard deviations of the noise by which a sample must be weaker than the strongest to bound the maximum."""


class OptimiserPolicy(SearchPolicy):
    """A maximiser of one variable as a policy that always answers: at its strongest sample.

    The interval reaches to the nearest samples on either side that are weaker, and clearly so where the noise is known:
    between them lies the maximum of a curve with one peak. It is a bracket and no probability.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    """

    name = "optimiser"

    least: int = 2
    """Fewest acquisitions."""

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16) -> None:
        super().__init__()
        self._budget = check_acquisitions(acquisitions, least=self.least, method=self.name)
        self._limits = limits

    @abstractmethod
    def _propose(self, asked_deg: Sequence[float], values: Sequence[float]) -> float | None:
        """Return the next angle in degrees inside the range, or None to end.

        ``asked_deg`` are the angles reached, moved to the nearer end where they lie beyond it; ``values`` the
        intensities over the first one that was not 0.
        """

    def estimate(self) -> Found:
        """Angle of the strongest sample; the middle of the range before the first."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """The same angle, bounded by samples that are weaker by more than the noise explains.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity, in the intensity's unit; None: any weaker sample bounds it.
        """
        if not self._lit:
            return self._found(self._limits.centre_deg, self._limits)
        best = max(self._lit, key=lambda sample: sample.reading.intensity)
        level = best.reading.intensity - CLEARLY_WEAKER * (noise_sigma or 0.0)
        weaker = [self._inside(sample.angle_deg) for sample in self._lit if sample.reading.intensity < level]
        mean_deg = self._inside(best.angle_deg)
        low_deg = max((angle_deg for angle_deg in weaker if angle_deg < mean_deg), default=self._limits.low_deg)
        high_deg = min((angle_deg for angle_deg in weaker if angle_deg > mean_deg), default=self._limits.high_deg)
        return self._found(mean_deg, Interval(low_deg=low_deg, high_deg=high_deg))

    def _found(self, mean_deg: float, bracket: Interval) -> Found:
        return Found(
            mean_deg=mean_deg,
            sigma_deg=bracket.width_deg / math.sqrt(12),
            interval95_deg=bracket,
            interval_kind="bracket",
        )

    def _next_deg(self) -> float | None:
        if len(self._lit) >= self._budget:
            return None
        unit = next((s.reading.intensity for s in self._lit if s.reading.intensity > 0), 1.0)
        angle_deg = self._propose(
            [self._inside(sample.angle_deg) for sample in self._lit],
            [sample.reading.intensity / unit for sample in self._lit],
        )
        return None if angle_deg is None else self._inside(angle_deg)

    def _inside(self, angle_deg: float) -> float:
        """The angle, or the end of the range beyond which the stage overshot: the optimisers hold no other."""
        return min(max(angle_deg, self._limits.low_deg), self._limits.high_deg)
