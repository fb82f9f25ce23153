"""What all samples of a search are measured by: unit, noise, and where the marker lies along the array."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markerseek.core.reading import LEAST_INTENSITY, Sample
from markerseek.search.floor import MOST_CELLS, Noise

CLEAR = 6.0
"""Intensity over σ from which a peak's place and arrival are the marker's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Basis:
    """What all samples of a search are measured by.

    Attributes
    ----------
    unit
        Largest intensity so far.
    sigma
        Noise of samples that do not tell theirs.
    marker_m
        Lateral position of the marker in metres; None while no sample is clear of the noise.
    cells
        Envelope cells of samples that do not tell theirs.
    """

    unit: float
    sigma: float
    marker_m: float | None
    cells: int

    def differs(self, former: Basis, *, told: bool) -> bool:
        """Whether a grid made with the former one must be made anew; ``told``: each sample tells noise and cells."""
        if self.marker_m is None or former.marker_m is None:
            moved = self.marker_m is not former.marker_m
        else:
            moved = abs(self.marker_m - former.marker_m) > 0.5e-3
        steady = told or (0.9 < self.sigma / former.sigma < 1.1 and 0.5 < self.cells / former.cells < 2)
        return moved or not steady or not former.unit <= self.unit <= 3 * former.unit


def all_told(lit: Sequence[Sample]) -> bool:
    """Whether each sample tells its noise and its cells."""
    return all(sample.reading.noise_sigma is not None and sample.reading.cells is not None for sample in lit)


def basis_of(lit: Sequence[Sample], noise: Noise) -> Basis:
    """Return what the samples are measured by.

    Where no sample tells the noise, the smallest intensity is taken for noise: σ is a quarter of it. Where none tells
    the cells, they are as many as the smallest intensity y allows: the largest of M reaches about σ·sqrt(2·ln M).
    """
    strongest = max(lit, key=lambda sample: sample.reading.intensity)
    largest = strongest.reading.intensity
    smallest = min(sample.reading.intensity for sample in lit)
    # The tails of a computed curve underflow, and have no ratio to one another.
    unit = largest if largest > LEAST_INTENSITY else 1.0
    sigma = max(noise.sigma or smallest / 4, 1e-4 * unit)
    clear = largest > max(CLEAR * sigma, noise.floor.level or 0.0)
    most = math.log(MOST_CELLS)
    return Basis(
        unit=unit,
        sigma=sigma,
        marker_m=strongest.reading.lateral_m if clear else None,
        cells=math.ceil(math.exp(min((smallest / sigma) ** 2 / 2, most))),
    )
