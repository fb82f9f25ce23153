"""Noise-free intensity curves S(t), and a simulated world of intensities that draws the peak of an image from them.

S(t) is the peak of the image t degrees off the marker, relative to that at t = 0. A curve gives the heights of the
separate peaks of the envelope image, strongest first: a long laser pulse and the edges of an element leave several of
nearly the same height (physics notes), and under noise any of them may be the largest. The closed forms have one peak.
The recorded form interpolates heights that were computed or measured on a grid.

The world is for studies of many searches, where a frame of channel data takes milliseconds and its peak is all that a
method uses. The noise is not added to the intensity; the peak is drawn as it is distributed:

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
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol, TypeAlias

import numpy as np

from markerseek.acoustics import Absorber
from markerseek.core import ConfigError, Float64, FrameHeader, ReadingFrame, Within, require_fields
from markerseek.sim.motion import displaced
from markerseek.sim.settings import SimulatedSettings
from markerseek.sim.world import Flash, flash_of, noise_gain


class IntensityCurve(Protocol):
    """Intensity over the angle off the marker, without noise."""

    def peaks(self, off_plane_deg: float) -> Sequence[float]:
        """Return the heights of the separate peaks of the image, over the largest with the probe on the marker."""


Width: TypeAlias = Annotated[float, Within(1e-6, 1e6, "deg", cure="2 to 35 deg are usual")]
"""Full width at half maximum of a curve, in degrees."""

_STEP_DEG = 0.02
"""Step of the fine grid of a recorded curve, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GaussianCurve:
    """exp(−4 ln 2·(t/w)²): its tails vanish, which those of a wideband pulse do not."""

    fwhm_deg: Width
    """Full width w at half maximum."""

    def __post_init__(self) -> None:
        require_fields(self, "curve")

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """Return one peak; see the class."""
        return (math.exp(-4 * math.log(2) * (off_plane_deg / self.fwhm_deg) ** 2),)


@dataclass(frozen=True, slots=True, kw_only=True)
class SechCurve:
    """1/cosh(2 arcosh(2)·t/w): exponential tails."""

    fwhm_deg: Width
    """Full width w at half maximum."""

    def __post_init__(self) -> None:
        require_fields(self, "curve")

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """Return one peak; see the class."""
        # Beyond 700 the hyperbolic cosine leaves the range of a double, and its inverse is 0 in any case
        return (1 / math.cosh(min(700.0, 2 * math.acosh(2) * abs(off_plane_deg) / self.fwhm_deg)),)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCurve:
    """1/(1 + (2|t|/w)^k): tails as 1/|t|^k, like the edge waves of an element for k near 1."""

    fwhm_deg: Width
    """Full width w at half maximum."""
    # With a steeper power the narrowest curve would overflow.
    power: Annotated[float, Within(0, 20, open_low=True, cure="1 to 2 are usual")] = 2.0
    """Exponent k of the tails; 2 is the Lorentz curve."""

    def __post_init__(self) -> None:
        require_fields(self, "curve")

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """Return one peak; see the class."""
        return (1 / (1 + (2 * abs(off_plane_deg) / self.fwhm_deg) ** self.power),)


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoPeaks:
    """Curve of two sources at different positions in the image, with a peak for each."""

    curve: IntensityCurve
    """Curve of the marker, and of the other source."""
    apart_deg: Annotated[float, Within(-180, 180, "deg")]
    """Angle of the other source less that of the marker."""
    relative: Annotated[float, Within(0, 1)]
    """Its height over the marker's."""

    def __post_init__(self) -> None:
        require_fields(self, "two peaks")

    def peaks(self, off_plane_deg: float) -> tuple[float, ...]:
        """Return the peaks of the marker, then those of the other source."""
        other = self.curve.peaks(off_plane_deg - self.apart_deg)
        return (*self.curve.peaks(off_plane_deg), *(self.relative * height for height in other))


class RecordedCurve:
    """A curve between recorded angles: monotone cubic pieces (PCHIP) tabulated on a fine grid, linear in between.

    Beyond the recorded angles the outermost heights hold.

    ``off_plane_deg``: angles off the marker, ascending. ``heights``: heights of the peaks at each, strongest first, not
    negative.
    """

    def __init__(
        self,
        off_plane_deg: Float64[np.ndarray, " angles"],
        heights: Float64[np.ndarray, "angles peaks"],
    ) -> None:
        if off_plane_deg.size < 2 or not np.all(np.diff(off_plane_deg) > 0):
            raise ConfigError("recorded curve: off_plane_deg must hold at least two angles, each above the one before")
        if heights.shape[:1] != off_plane_deg.shape or heights.ndim != 2:
            raise ConfigError(f"recorded curve: heights have the shape {heights.shape}, (angles, peaks) is needed")
        if not np.all((heights >= 0) & np.isfinite(heights)):
            raise ConfigError("recorded curve: heights must be finite and not negative")
        count = max(2, math.ceil((off_plane_deg[-1] - off_plane_deg[0]) / _STEP_DEG) + 1)
        fine = np.linspace(off_plane_deg[0], off_plane_deg[-1], count)
        self._low_deg = float(fine[0])
        self._per_deg = (count - 1) / float(fine[-1] - fine[0])
        self._last = count - 1
        # Imported here: it takes a third of a second, and a search on frames does not need it.
        from scipy.interpolate import PchipInterpolator

        # Lists of floats: a lookup of one angle is four times as fast as in an array.
        self._rows: list[list[float]] = np.maximum(PchipInterpolator(off_plane_deg, heights)(fine), 0).tolist()

    def peaks(self, off_plane_deg: float) -> list[float]:
        """Return the heights at an angle off the marker in degrees."""
        place = min(max((off_plane_deg - self._low_deg) * self._per_deg, 0.0), float(self._last))
        left = min(int(place), self._last - 1)
        share = place - left
        return [(1 - share) * a + share * b for a, b in zip(self._rows[left], self._rows[left + 1], strict=True)]


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
        self._curve = curve
        self._cells = cells
        self._marker = Absorber(radius_m=settings.marker.radius_m, angle_deg=marker_deg)
        self.motion = settings.motion.drawn(rng)
        """How the tissue moves; of that, the part along the turn changes the intensity."""
        self._peak = 10 ** (settings.noise.peak_snr_db / 20)
        self._laser = settings.laser
        self._rng = rng
        self._noise_stated = noise_stated

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue with the mean energy of this number of pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._laser.energy_jitter))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ReadingFrame:
        """Return the frame with the intensity after a flash; after none, that of noise alone."""
        # Drawn also where the marker is far stronger: the numbers that follow must not depend on the curve.
        largest = largest_noise(self._rng, cells=self._cells)
        noise_sigma = 1.0 if flash is None else noise_gain(self._laser.pulses, flash)
        if flash is not None and self._curve is not None:
            snr = flash.energy * self._peak / noise_sigma
            heights = self._curve.peaks(self.angle_deg - self._marker_deg(flash))
            noise = self._rng.standard_normal((len(heights), 4)).tolist()
            for height, (along, *across) in zip(heights, noise, strict=True):
                largest = max(largest, math.hypot(snr * height + along, *across))
        return ReadingFrame(
            header=header,
            intensity=largest * noise_sigma,
            noise_sigma=noise_sigma if self._noise_stated else None,
            cells=self._cells if self._noise_stated else None,
        )

    def _marker_deg(self, flash: Flash) -> float:
        """Return the angle of the marker at a flash."""
        if not self.motion.moves:
            return self._marker.angle_deg
        pulse_period_s = 1 / self._laser.rate_hz
        middle_s = flash.at_s + (flash.pulses - 1) * pulse_period_s / 2
        return displaced(self._marker, self.motion.displacement_m(np.array([middle_s]))[0]).angle_deg


def largest_noise(rng: np.random.Generator, *, cells: int) -> float:
    """Return the largest noise in an image over σ, drawn by inverting 1 − exp(−N(u)); see the module.

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
