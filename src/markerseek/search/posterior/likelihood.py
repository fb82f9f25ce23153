"""Likelihood of one intensity: samples as observations on a common scale, and p(y|μ) as a table over ln(μ/y).

The envelope y at the marker's pixel is Rician, with μ the noise-free height and σ one quadrature of the noise; a
relative error ε of the model widens it to σ² + (εμ)². The image's largest peak is that pixel's or the largest E of M
Rayleigh cells elsewhere, whichever is higher (Rice 1945; order statistics):

    p(y|μ) = f_R(y|μ)·F_E(y)·g + f_E(y)·F_R(y|μ),       F_E(y) = (1 − exp(−y²/2σ²))^M,                         (3)

where g is the density of the peak's lateral position for the marker over that for noise: a marker stays at its lateral
position, noise is anywhere. The standard deviation of f_R is taken as `PEAK_NOISE`·σ, for the cells about the pixel are
nearly as high, and F_R as normal, which it is to a few per cent once y exceeds 3σ, as the largest of M cells always
does. One frame in a hundred is an outlier: it may hold anything over `OUTLIER_RANGE` in ln y.

Pulses of sweeps that gave no light are left out before (`with_light`), and a delay of the light that is known moves the
angles of the others (`later`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import numpy as np
from msgspec.structs import replace

from markerseek._compiled import compiled
from markerseek.core import (
    MIN_INTENSITY,
    USUAL_FACE_RADIUS_M,
    Float64,
    Sample,
    SweepTiming,
    displacement_sigmas,
)
from markerseek.search.floor import MAX_CELLS, SearchNoise, noise_factor

TABLE_LOW = -6.0
TABLE_HIGH = 3.0
TABLE_STEP = 0.02
"""Ends and step of the table in ln(μ/y)."""

_MU = np.exp(np.arange(TABLE_LOW, TABLE_HIGH + TABLE_STEP / 2, TABLE_STEP))

TABLE_SIZE = _MU.size
"""Entries of the table."""

OUTLIER_SHARE = 0.01
"""Prior probability that a frame is an outlier, which contains no information on the marker."""

OUTLIER_RANGE = 7.0
"""Range of ln y over which the intensity of an outlier is uniform."""

LATERAL_SIGMA_M = 0.5e-3
"""Standard deviation of the lateral position of one marker's peak, a pitch at most; in metres."""

IMAGE_WIDTH_M = 55e-3
"""Width of the image, over which the peaks of noise are uniform, in metres."""

MIN_LATERAL_RATIO = 0.02
"""Smallest g: a peak at another lateral position costs a marker at most a factor of 50."""

PEAK_NOISE = 0.8
"""Standard deviation of a peak over that of one cell: the largest of several cells, all nearly as high, varies less
than each of them. The medians of 40 simulated markers, each measured 25 times at its angle, were 0.52, 0.63, 0.74, 0.81
and 0.92 with peaks of 5.6, 7.5, 11, 32 and 100σ."""

STRONG_SNR = 8.0
"""Intensity over σ from which ln y is normal."""

FAR_TAIL = 0.08
FAR_TAIL_ERROR = 0.01
"""Share of the strongest intensity below which the form of a curve is unknown, and by what share of it: the tails of
edge waves, of an exponential and of a Gaussian are orders of magnitude apart, and where little noise shows them, many
samples, which would outvote those of the top."""

AT_REST = 0.5
"""Error of a sample at rest by the laser's energy, over that of a single pulse of a sweep: such a sample is the mean of
an unknown number of pulses, usually 16, and the energy drifts besides."""

CLEAR_SNR = 6.0
"""Intensity over σ from which a peak's lateral position and arrival are the marker's."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observation:
    """One sample with the laser on, in the terms of the likelihood."""

    angle_deg: float
    log_intensity: float
    """ln of the intensity over the unit of the search."""
    noise: float
    """Standard deviation σ of one quadrature over the intensity."""
    cells: int
    """Number M of independent envelope cells."""
    lateral_ratio: float
    """g of the peak's lateral position, `lateral_ratio`."""
    spot: tuple[float, float] | None = None
    """ln of the amplitude of the spot's energy over the unit of the search, and the standard deviation that noise gives
    it; None if not known."""
    sweep: SweepTiming | None = None
    """What its angle shares with those of its sweep; None if the probe was at rest."""
    angle_sigma_deg: float = 0.0
    """Standard deviation of the error of its angle by itself."""
    displaced_sigma_deg: float = 0.0
    """Standard deviation of its angle by what is not known of the displacement of the tissue."""
    energy_share: float = 1.0
    """What the laser's energy adds to it, over the `Hypotheses.sample_error` of a search."""
    number: int = -1
    """Its place among the samples of the search, from 0; -1: none, as that of an upper limit."""
    beside: int = 1
    """How many weak observations, itself included, count as one: what the curve differs from its template by is nearly
    the same in all of them."""

    @property
    def strong(self) -> bool:
        """Whether it is the marker's, and its ln y normal."""
        return self.noise <= 1 / STRONG_SNR and self.lateral_ratio >= 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """What all samples of a search are measured by."""

    unit: float
    """Largest intensity so far."""
    sigma: float
    """Noise of samples whose reading does not state it."""
    marker_m: float | None
    """Lateral position of the marker; None while no sample is clear of the noise."""
    cells: int
    """Envelope cells of samples whose reading does not state them."""
    radius_m: float
    """Distance of the marker from the axis."""

    def replaces(self, former: Scale, *, stated: bool) -> bool:
        """Return whether a grid of the former scale must be computed again.

        ``stated``: all readings state noise and cells.
        """
        if self.marker_m is None or former.marker_m is None:
            moved = self.marker_m is not former.marker_m
        else:
            moved = abs(self.marker_m - former.marker_m) > LATERAL_SIGMA_M
        steady = stated or (0.9 < self.sigma / former.sigma < 1.1 and 0.5 < self.cells / former.cells < 2)
        # The amplitudes of the coarse grid reach from 0.5 to 82 units.
        return moved or not steady or not former.unit <= self.unit <= 3 * former.unit

    def observation(self, sample: Sample, *, use_lateral: bool, swept: bool, number: int = -1) -> Observation:
        """Return a sample in the terms of the likelihood; its lateral position counts if ``use_lateral``.

        ``swept``: whether the search has sweeps, in which each sample is of one pulse. ``number``: of `Observation`.
        """
        reading = sample.reading
        sigma = reading.noise_sigma if reading.noise_sigma is not None and reading.noise_sigma > 0 else self.sigma
        # An intensity of 0 has no logarithm; a hundredth of σ is as improbable.
        intensity = max(reading.intensity, 0.01 * sigma)
        cells = reading.cells or self.cells
        if intensity < FAR_TAIL * self.unit and sigma < FAR_TAIL_ERROR * self.unit:
            sigma = FAR_TAIL_ERROR * self.unit
            cells = 1
        # Where the image is looked up at a known place, few cells say what g says, and say it better.
        anywhere = use_lateral and reading.local_maxima is None
        return Observation(
            # Of a whole number too: the kernels take floats.
            angle_deg=float(sample.angle_deg),
            log_intensity=math.log(intensity) - math.log(self.unit),
            noise=sigma / intensity,
            cells=cells,
            lateral_ratio=lateral_ratio(reading.lateral_m, marker_m=self.marker_m) if anywhere else 1.0,
            spot=None
            if reading.spot is None
            else (math.log(reading.spot.amplitude) - math.log(self.unit), reading.spot.relative_sigma),
            sweep=sample.sweep,
            angle_sigma_deg=sample.angle_sigma_deg,
            displaced_sigma_deg=displaced_sigma_deg(sample, radius_m=self.radius_m),
            energy_share=AT_REST if swept and sample.sweep is None else 1.0,
            number=number,
        )


def scale_of(lit: Sequence[Sample], noise: SearchNoise) -> Scale:
    """Return what the samples with the laser on are measured by.

    Where no reading states the noise, the smallest intensity is assumed to be noise: σ is a quarter of it. Where none
    states the cells, they are as many as the smallest intensity y allows: the largest of M is about σ·sqrt(2·ln M).
    """
    strongest = max(lit, key=lambda sample: sample.reading.intensity)
    largest = strongest.reading.intensity
    smallest = min(sample.reading.intensity for sample in lit)
    # The tails of a computed curve underflow, and have no ratio to one another.
    unit = largest if largest > MIN_INTENSITY else 1.0
    # Never 0, for intensities are divided by it.
    sigma = max(noise.sigma or smallest / 4, 1e-4 * unit)
    # A peak below this may be noise, whose lateral position says nothing.
    clear = largest > max(CLEAR_SNR * sigma, noise.level_or_zero)
    most = math.log(MAX_CELLS)
    return Scale(
        unit=unit,
        sigma=sigma,
        marker_m=strongest.reading.lateral_m if clear else None,
        cells=math.ceil(math.exp(min((smallest / sigma) ** 2 / 2, most))),
        radius_m=radius_m(strongest.reading.depth_m),
    )


_USUAL_RADIUS_M = 55e-3
"""Distance of the marker from the axis in metres, if the frames do not tell it."""


def radius_m(depth_m: float | None) -> float:
    """Return the distance of the marker from the axis, in metres.

    ``depth_m``: its distance from the array's face; None if unknown.
    """
    return _USUAL_RADIUS_M if depth_m is None else USUAL_FACE_RADIUS_M + depth_m


def displaced_sigma_deg(sample: Sample, *, radius_m: float) -> float:
    """Return the standard deviation of the angle of a sample by what is not known of the displacement of the tissue."""
    return math.degrees(displacement_sigmas(sample).turn_m / radius_m)


def lateral_ratio(lateral_m: float | None, *, marker_m: float | None) -> float:
    """Return g: the density of a peak's lateral position for the marker over that for noise; 1 where unknown.

    ``lateral_m``: lateral position of the peak. ``marker_m``: lateral position of the marker.
    """
    if lateral_m is None or marker_m is None:
        return 1.0
    away = (lateral_m - marker_m) / LATERAL_SIGMA_M
    ratio = IMAGE_WIDTH_M / (LATERAL_SIGMA_M * math.sqrt(2 * math.pi)) * math.exp(-(away**2) / 2)
    return max(ratio, MIN_LATERAL_RATIO)


@lru_cache(maxsize=512)
def log_tables(
    *, noise: float, cells: int, errors: tuple[float, ...], ratio: float = 1.0
) -> Float64[np.ndarray, "errors entries"]:
    """Return ln p(y|μ)·y of (3) over ln(μ/y) from `TABLE_LOW` to `TABLE_HIGH`, one row for each model error.

    ``noise``: σ/y, positive. ``cells``: number M of independent cells. ``errors``: relative errors ε of the model.
    ``ratio``: g of `lateral_ratio`.
    """
    # Its square is neither 0 nor infinite.
    noise = min(max(noise, 1e-100), 1e100)
    # exp(−y²/2σ²) underflows beyond 700, and log1p needs a value above −1.
    rayleigh = math.exp(-min(1 / (2 * noise**2), 700.0))
    below = math.exp(cells * math.log1p(-min(rayleigh, 1 - 1e-12)))
    # f_E of (3) at y = 1, the derivative of F_E = ``below``; both in units of 1/y.
    largest = cells * rayleigh / noise**2 * below / max(1 - rayleigh, 1e-12)
    good = 1 - OUTLIER_SHARE
    tables = np.empty((len(errors), TABLE_SIZE))
    signal = good * below * ratio
    noise_alone = good * largest
    outlier = OUTLIER_SHARE / OUTLIER_RANGE
    _fill_tables(_MU, PEAK_NOISE * noise, signal, noise_alone, outlier, np.array(errors), tables)
    # The cache hands the same array to all callers.
    tables.flags.writeable = False
    return tables


@compiled
def _fill_tables(
    mu: Float64[np.ndarray, " entries"],
    noise: float,
    below: float,
    largest: float,
    outlier: float,
    errors: Float64[np.ndarray, " errors"],
    out: Float64[np.ndarray, "errors entries"],
) -> None:
    """Fill in (3) at y = 1: ln(f_R(1|μ)·below + largest·Φ((1 − μ)/σ) + outlier), σ² = noise² + (εμ)².

    The Rician density f_R is exp(−(1 − μ)²/2σ²)/σ²·exp(−x)·I₀(x), x = μ/σ²: by its series for small x and the first
    terms of its expansion for large ones (Abramowitz and Stegun 9.6.12, 9.7.1), to 1e-4. 3 to 10 times as fast as
    SciPy's i0e and ndtr on the whole table (`benchmarks.kernels`), of which most densities are 0.
    """
    for row in range(errors.size):
        for k in range(mu.size):
            variance = noise**2 + (errors[row] * mu[k]) ** 2
            away = (1 - mu[k]) ** 2 / (2 * variance)
            density = 0.0
            # Beyond exp(−40) the outliers' density is all that is left.
            if away < 40.0:
                x = mu[k] / variance
                if x > 8.0:
                    bessel = (1 + 0.125 / x * (1 + 0.5625 / x * (1 + 1.0416667 / x))) / math.sqrt(2 * math.pi * x)
                else:
                    term = 1.0
                    total = 1.0
                    for order in range(1, 24):
                        term *= (x / (2 * order)) ** 2
                        total += term
                    bessel = total * math.exp(-x)
                density = math.exp(-away) / variance * bessel
            # F_R of (3): the marker's own envelope stays below a noise peak of height 1.
            reached = 0.5 * math.erfc((mu[k] - 1) / math.sqrt(2 * variance))
            out[row, k] = math.log(density * below + largest * reached + outlier)


LIT_RATIO = 1.3
"""A pulse at the noise had no light if the pulses before and after exceed the largest noise by this factor."""


NOISE_EXCEEDANCE = 0.01
"""Probability with which noise alone has a larger peak in one frame than a pulse without light."""


def with_light(samples: Sequence[Sample]) -> list[Sample]:
    """Return the samples without the pulses of sweeps that gave no light.

    Such a pulse is no higher than noise, and the pulses before and after it in its sweep are clear of the noise.
    """
    kept: list[Sample] = []
    for sweep, group in groupby(samples, key=lambda sample: None if sample.sweep is None else sample.sweep.number):
        own = list(group)
        kept += own if sweep is None else _lit(own)
    return kept


def _lit(swept: Sequence[Sample]) -> list[Sample]:
    """Return the pulses of one sweep that gave light."""
    level = np.array([_noise_level(sample) for sample in swept])
    height = np.array([sample.reading.intensity for sample in swept])
    quiet = height <= level
    clear = height >= LIT_RATIO * level
    dark = np.zeros(len(swept), dtype=bool)
    dark[1:-1] = quiet[1:-1] & clear[:-2] & clear[2:]
    return [sample for sample, off in zip(swept, dark, strict=True) if not off]


def _noise_level(sample: Sample) -> float:
    """Return the height that noise seldom exceeds; 0 where the noise is not known."""
    reading = sample.reading
    if reading.noise_sigma is None or reading.cells is None:
        return 0.0
    return reading.noise_sigma * noise_factor(cells=reading.cells, frames=1, false_found=NOISE_EXCEEDANCE)


def later(samples: Sequence[Sample], delay_s: float) -> list[Sample]:
    """Return the samples with the angles at which the light comes if it is later by this delay."""
    return [
        sample
        if sample.sweep is None
        else replace(sample, angle_deg=sample.angle_deg + sample.sweep.speed_deg_s * delay_s)
        for sample in samples
    ]
