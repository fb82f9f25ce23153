"""The detection threshold of a search, from its samples: the largest intensity that noise alone reaches.

The largest of M independent envelope cells of Rayleigh noise exceeds x with probability 1 − (1 − exp(−x²/2σ²))^M, and
N frames have M·N cells. The threshold for a share p of false finds is therefore

    σ·sqrt(2·ln(M·N/p)),

6.2 σ for 12,800 cells, 15 frames and p = 1e-3. The sources, best first:

1. dark samples (laser off): the root mean square of their ``noise_sigma``. Samples without it give σ by their
   intensity, each being the largest of M cells: σ = (largest dark intensity)/sqrt(2·ln(1/(1 − 2^(−1/M)))), as if it
   were the median of such maxima, which the largest of few dark samples usually exceeds;
2. the lit frames' own ``noise_sigma``: its median, or that of the strongest frame where larger, so that a burst raises
   its own threshold;
3. the lower quartile of the intensities at 12 angles or more, each weighted by the part of the range around it
   (for equal steps the plain quartile); the threshold follows as from dark samples, with the quartile for the median.
   The quartile may be a marker's tail, so that σ itself is taken smaller where the curve is smoother than noise.
   Intensities of a file need not be maxima of an image: where those of even steps scatter more than such maxima, as
   absolute values of normal noise do by s = σ·sqrt(1 − 2/π), the threshold is what that noise reaches above the
   quartile, σ·sqrt(2·ln(N/p)), and σ is no less than that of the scatter. Where they scatter too little for noise of
   any kind, they lie on a background, and the threshold is what noise of the scatter s reaches above it
   (`_noise_above`);
4. nothing: the threshold is unknown.

The threshold is never below the largest dark intensity: real noise has tails and bursts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs

from markerseek.core import FALSE_FOUND, Floor, Sample
from markerseek.search.background import Background, background_of, background_sigma
from markerseek.search.curve import Curve, curve_of, lower_quartile, scatter_of

MAX_CELLS = 128 * 2080
"""Cells where a reading with known σ does not state them: as many as a frame has samples, so that the threshold is
high."""

FEWEST_CELLS = 30
"""Cells where σ is read off the maxima themselves: fewer than any image has, because fewer cells leave more room above
a maximum. With 30, three dark intensities or a quartile of 15 keep false finds to 1e-3 for images of 100 cells or more.
"""

QUARTILE_ANGLES = 12
"""Angles that a lower quartile needs."""

SMOOTHNESS = 3.4
"""Largest σ over the scatter of the samples. The largest of M Rayleigh cells scatters by π/sqrt(6)/sqrt(2·ln M)·σ,
0.30 σ for 12,800 cells, and a sample above the noise by σ: this fits the former and is generous to the latter."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchNoise:
    """Noise of a search."""

    floor: Floor
    sigma: float | None
    """Standard deviation of one intensity, in its unit; None where unknown."""
    background: Background | None = None
    """What lies below all samples, where no noise explains it; the floor is counted from it."""

    @property
    def measured_floor(self) -> Floor:
        """Floor in the intensities as they are measured: of a sloping background, that in the middle of the angles."""
        if self.background is None or self.floor.level is None:
            return self.floor
        return structs.replace(
            self.floor, level=self.floor.level + self.background.level, background=self.background.level
        )

    @property
    def level_or_zero(self) -> float:
        """Level of the floor; 0 where it is unknown, so that any intensity counts as a signal."""
        return 0.0 if self.floor.level is None else self.floor.level

    @property
    def sigma_or_zero(self) -> float:
        """Standard deviation of one intensity; 0 where it is unknown, so that no difference is put down to noise."""
        return 0.0 if self.sigma is None else self.sigma


def noise_factor(*, cells: int, frames: int, false_found: float = FALSE_FOUND) -> float:
    """Return the threshold over σ, sqrt(2·ln(M·N/p))."""
    return math.sqrt(2 * math.log(max(1, cells) * max(1, frames) / false_found))


def noise_of(lit: Sequence[Sample], *, dark: Sequence[Sample] = ()) -> SearchNoise:
    """Return the noise of a search from its samples, by the best source that they allow."""
    noise = noise_above_background(lit, dark=dark)
    return replace(noise, floor=noise.measured_floor, background=None)


def noise_above_background(lit: Sequence[Sample], *, dark: Sequence[Sample] = ()) -> SearchNoise:
    """Return the same noise with its background, from which the floor is then counted: see `above_background`."""
    if dark:
        return _from_dark(dark, frames=len(lit))
    if lit and all(sample.reading.noise_sigma is not None for sample in lit):
        return _from_frames(lit)
    if len({sample.angle_deg for sample in lit}) >= QUARTILE_ANGLES:
        return _from_quartile(lit)
    return SearchNoise(floor=Floor(level=None, source="unknown"), sigma=None)


def _from_dark(dark: Sequence[Sample], *, frames: int) -> SearchNoise:
    largest = max(sample.reading.intensity for sample in dark)
    sigmas = [sample.reading.noise_sigma for sample in dark if sample.reading.noise_sigma is not None]
    if sigmas:
        cells = _cells(dark, otherwise=MAX_CELLS)
        sigma = math.sqrt(sum(value**2 for value in sigmas) / len(sigmas))
    else:
        cells = _cells(dark, otherwise=FEWEST_CELLS)
        sigma = largest / _quantile_factor(0.5, cells=cells)
    level = max(largest, sigma * noise_factor(cells=cells, frames=frames))
    return SearchNoise(floor=Floor(level=level, source="dark frames"), sigma=sigma)


def _from_frames(lit: Sequence[Sample]) -> SearchNoise:
    # `noise_of` comes here only where every reading states its noise.
    sigmas = [sample.reading.noise_sigma for sample in lit if sample.reading.noise_sigma is not None]
    # A burst raises the noise of its own frame: the strongest frame's σ counts if it is larger.
    strongest = max(range(len(lit)), key=lambda index: lit[index].reading.intensity)
    sigma = max(float(np.median(sigmas)), sigmas[strongest])
    level = sigma * noise_factor(cells=_cells(lit, otherwise=MAX_CELLS), frames=len(lit))
    return SearchNoise(floor=Floor(level=level, source="noise of the frames"), sigma=sigma)


def _from_quartile(lit: Sequence[Sample]) -> SearchNoise:
    curve = curve_of(lit)
    cells = _cells(lit, otherwise=FEWEST_CELLS)
    quartile = lower_quartile(curve)
    scatter = scatter_of(curve)
    of_maxima = quartile / _quantile_factor(0.25, cells=cells)
    of_absolute_values = scatter / math.sqrt(1 - 2 / math.pi) if _is_even(curve) else 0.0
    level = max(
        of_maxima * noise_factor(cells=cells, frames=len(lit)),
        quartile + of_absolute_values * noise_factor(cells=1, frames=len(lit)),
    )
    sigma = min(max(of_maxima, of_absolute_values), SMOOTHNESS * scatter)
    background = background_of(curve, scatter=scatter)
    if background is not None:
        level = _noise_above(scatter, samples=len(lit))
        sigma = background_sigma(curve, background, scatter=scatter)
    return SearchNoise(floor=Floor(level=level, source="lower quartile"), sigma=sigma, background=background)


def _noise_above(scatter: float, *, samples: int) -> float:
    """Return what noise of this scatter reaches above the lower quartile.

    Maxima of images are distributed as Gumbel says, with longer tails than absolute values of normal noise: they exceed
    their quartile by (ln(N/p) + ln ln 4)·sqrt(6)/π standard deviations in a share p of N samples. The scatter of few
    samples may come out too small; the factor was fitted to 20,000 tables each of 12 to 300 such maxima.
    """
    unsure = 1 + 3 / math.sqrt(samples)
    return unsure * scatter * math.sqrt(6) / math.pi * (math.log(samples / FALSE_FOUND) + math.log(math.log(4)))


def above_background(lit: Sequence[Sample], background: Background | None) -> Sequence[Sample]:
    """Return the samples with their intensities above a background; the samples themselves if there is none."""
    if background is None:
        return lit
    rest = [max(0.0, each.reading.intensity - background.at(each.angle_deg)) for each in lit]
    return [
        structs.replace(sample, reading=structs.replace(sample.reading, intensity=intensity))
        for sample, intensity in zip(lit, rest, strict=True)
    ]


def _cells(samples: Sequence[Sample], *, otherwise: int) -> int:
    """Return the largest number of cells that a sample names."""
    return max((sample.reading.cells for sample in samples if sample.reading.cells is not None), default=otherwise)


def _quantile_factor(share: float, *, cells: int) -> float:
    """Return the quantile of the largest of M Rayleigh cells over σ: (1 − exp(−x²/2))^M = share."""
    return math.sqrt(-2 * math.log(-math.expm1(math.log(share) / max(1, cells))))


def _is_even(curve: Curve) -> bool:
    """Return whether the angles have even steps, as those of a scan: about a search's own, far apart, a curve bends."""
    steps_deg = np.diff(np.unique(curve.angle_deg))
    return bool(steps_deg.max() <= 2 * np.median(steps_deg))
