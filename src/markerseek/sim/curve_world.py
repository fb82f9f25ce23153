"""A simulated world of intensities: the peak of an envelope image is drawn from its distribution, without the image.

For studies of many searches, where a frame of channel data takes milliseconds and its peak is all that a method uses.
The noise is not added to the intensity; the peak is drawn as it is distributed:

- each separate peak of the image, of noise-free height A, is |(A + σn₁, σn₂, σn₃, σn₄)|: in phase, in quadrature, and
  for the search of the maximum along either axis, which to second order adds σ²/2A each, as the quadrature does;
- the largest of the noise elsewhere exceeds u·σ with probability 1 − exp(−N(u)), N(u) = ρ(u² − 1)exp(−u²/2) peaks
  above u on average (Worsley 1994, as in `markerseek.signals.noise_gain.envelope_cells`); ρ follows from the number of
  cells M that a reading names, M = ρ(u² − 1) where N(u) = 1e-3, and from the share of peaks that a reader sees; below
  u² = 3, where N(u) falls again, it is that of independent cells;
- the intensity is the largest of all. It is biased upward and never 0.

Left out: lateral position and depth, quantisation, saturation. The tests of the studies compare it with frames.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import ConfigError, FrameHeader, ReadingFrame
from markerseek.sim.curves import IntensityCurve
from markerseek.sim.settings import SimulatedSettings
from markerseek.sim.world import Flash, flash_of, noise_gain

_CELLS_AT = 1e-3
"""Probability of a false alarm at which a reading's number of cells is defined."""

_SEEN = 0.55
"""Share of the noise peaks that a reader sees at their height: it refines the largest pixel only, and midway between
two columns a peak is up to 4 dB too low in the pixels. Set from about a hundred dark frames of the simulated rig;
400 of another four seeds give 0.50 ± 0.025 by maximum likelihood, which is 0.02 σ in the mean of the largest noise."""


class CurveWorld:
    """Tissue that is described by its intensity curve alone, in units of the noise's standard deviation.

    ``settings``: noise, laser and start. ``curve``: None is a world without a marker. ``cells``: number of independent
    envelope cells of an image. ``noise_stated``: whether a frame states the noise and the cells; those of a CSV do not.
    """

    def __init__(
        self,
        settings: SimulatedSettings,
        *,
        curve: IntensityCurve | None,
        marker_deg: float,
        cells: int,
        rng: np.random.Generator,
        noise_stated: bool = True,
    ) -> None:
        if settings.noise.bursts is not None:
            raise ConfigError("noise: bursts are simulated in frames only; leave them out, or study frames")
        if cells < 10:
            raise ConfigError(f"curve world: cells is {cells}, at least 10 are needed; an image has some 100,000")
        self.angle_deg = settings.start_deg
        self.flashes: list[Flash] = []
        self._curve, self._marker_deg, self._cells = curve, marker_deg, cells
        self._peak = 10 ** (settings.noise.peak_snr_db / 20)
        self._laser, self._rng, self._noise_stated = settings.laser, rng, noise_stated

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue with the mean energy of this number of pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._laser.energy_jitter))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ReadingFrame:
        """Frame with the intensity after a flash; after none, that of noise alone."""
        # Drawn also where the marker is far stronger: the numbers that follow must not depend on the curve.
        largest = largest_noise(self._rng, cells=self._cells)
        noise_sigma = 1.0 if flash is None else noise_gain(self._laser.pulses, flash)
        if flash is not None and self._curve is not None:
            snr = flash.energy * self._peak / noise_sigma
            heights = self._curve.peaks(self.angle_deg - self._marker_deg)
            noise = self._rng.standard_normal((len(heights), 4)).tolist()
            for height, (along, *across) in zip(heights, noise, strict=True):
                largest = max(largest, math.hypot(snr * height + along, *across))
        return ReadingFrame(
            header=header,
            intensity=largest * noise_sigma,
            noise_sigma=noise_sigma if self._noise_stated else None,
            cells=self._cells if self._noise_stated else None,
        )


def largest_noise(rng: np.random.Generator, *, cells: int) -> float:
    """Largest noise in an image over σ, drawn by inverting 1 − exp(−N(u)); see the module.

    ``cells``: number of independent envelope cells of the image, at least 10.
    """
    # ρ of the module docstring: M = ρ(u² − 1), with u² = 2·ln(M/1e-3) where a reading defines M.
    rate = _SEEN * cells / (2 * math.log(cells / _CELLS_AT) - 1)
    # 1 − exp(−N(u)) is uniform, so N(u) is exponential; u follows by fixed-point iteration of N(u) = wanted.
    wanted = rng.standard_exponential()
    # From u² − 1 = 20, that of a usual image; each step reduces the error about tenfold (by 2/(u² − 1)).
    square = 2 * math.log(rate * 20 / wanted)
    for _ in range(4):
        square = 2 * math.log(rate * max(square - 1, 2.0) / wanted)
    # Below u² = 3, which a small image may come to, N(u) falls again. There u is the largest of as many independent
    # cells, each above it with probability exp(−u²/2), as give the same at u² = 3: no two images have the same noise.
    share = math.exp(-3 / 2)
    if wanted > 2 * rate * share:
        square = -2 * math.log(-math.expm1(math.log1p(-share) / share * wanted / (2 * rate)))
    return math.sqrt(square)
