"""What all adapters share: the check of their package, and the strongest sample as the answer."""

from __future__ import annotations

import importlib
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from markerseek.core import PAPER_RANGE, Found, Interval, needs_package
from markerseek.search import SearchPolicy, check_acquisitions

CLEARLY_WEAKER = 3.0
"""Standard deviations of the noise by which a sample must be weaker than the strongest to bound the maximum."""

INITIAL = 4
"""Angles of the first, space-filling design of the Bayesian optimisers."""

SEED = 1
"""Seed of their random choices."""


class OptimiserPolicy(SearchPolicy):
    """A maximiser of one variable as a policy, which always answers with the angle of its strongest sample.

    The interval reaches to the nearest weaker samples on either side; where the noise is known, to the nearest that
    are weaker by `CLEARLY_WEAKER`. The maximum of a curve with one peak lies between them. The interval is a bracket
    and has no probability.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.

    Raises
    ------
    ConfigError
        If there are too few acquisitions.
    MissingExtraError
        If the package is not installed.
    """

    summary: ClassVar[str]
    """What it is, in one line."""

    least: ClassVar[int] = 2
    """Fewest acquisitions."""

    package: ClassVar[str | None] = None
    """Optional package that it imports; None for those that are always installed."""

    extra: ClassVar[str] = ""
    """Extra of this package that installs it."""

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16) -> None:
        super().__init__()
        self._budget = check_acquisitions(acquisitions, least=self.least, method=self.name)
        if self.package is not None:
            # Before the first acquisition, not at the end of the first design.
            with needs_package(self.name, extra=self.extra, purpose=f"the method {self.name}"):
                importlib.import_module(self.package)
        self._limits = limits

    @abstractmethod
    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        """Return the next angle in degrees inside the range, or None to end.

        ``angles_deg`` are the angles of the samples, moved to the nearer end of the range where they lie outside;
        ``values`` are the intensities divided by the first that is not 0.
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
        level = best.reading.intensity
        if noise_sigma is not None:
            level -= CLEARLY_WEAKER * noise_sigma
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
        # The next angle must not depend on the unit of the intensities.
        unit = next((s.reading.intensity for s in self._lit if s.reading.intensity > 0), 1.0)
        angle_deg = self._propose(
            [self._inside(sample.angle_deg) for sample in self._lit],
            [sample.reading.intensity / unit for sample in self._lit],
        )
        return None if angle_deg is None else self._inside(angle_deg)

    def _inside(self, angle_deg: float) -> float:
        """The angle, or the nearer end of the range if the stage went beyond it: the optimisers accept no other."""
        return self._limits.nearest(angle_deg)
