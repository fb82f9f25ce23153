"""The measured intensity curve S(θ): the samples of a search in order of their angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64, Sample


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """Samples of S(θ) in ascending order of the angle."""

    angle_deg: Float64[np.ndarray, " samples"]
    """Angles reached, ascending; an angle may occur twice."""
    intensity: Float64[np.ndarray, " samples"]
    """Intensities at these angles, in the unit of the samples."""

    def __len__(self) -> int:
        return self.angle_deg.size

    @property
    def strongest(self) -> int:
        """Index of the largest intensity; of several, the one at the lowest angle."""
        return int(np.argmax(self.intensity))


def curve_of(samples: Sequence[Sample]) -> Curve:
    """Return the samples as a curve."""
    angle_deg = np.array([sample.angle_deg for sample in samples], dtype=np.float64)
    intensity = np.array([sample.reading.intensity for sample in samples], dtype=np.float64)
    order = np.argsort(angle_deg, kind="stable")
    return Curve(angle_deg=angle_deg[order], intensity=intensity[order])
