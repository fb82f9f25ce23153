"""Prior of the intensity curve S(t): a family of shapes, and the error of its best member.

    S(t) = (1 + (2^(q/p) − 1)·(2|t|/F)^q)^(−p/q),      or  2^(−(2t/F)²)                                         (1)

with F the full width at half maximum, tails as 1/|t|^p and a knee that is sharper for larger q. Of the acoustic
model's own curves (150 draws of every unknown of the physics table) the family follows the top to a few per cent;
between 0.05 and 0.5 of the peak the curves have shoulders of their own, 10 to 30 % off any smooth member. `MODEL_ERROR`
states that, level by level.

A high element close to the marker, or far out of focus, is the exception: its curve has two peaks, a third above the
centre. There S is the field behind a slit of half width 1 with Fresnel number n (Born and Wolf, 8.7),

    |F(√(2n)·(1 + u)) + F(√(2n)·(1 − u))|,       F = C + iS the Fresnel integral, u in proportion to t,        (2)

its square averaged over the band.

A former marker on the same rig gives a narrower prior: curves of about its width, and amplitudes of about its height.
Element, lens, laser pulse and face radius are the rig's, and shape the curve of each marker alike; depth and size are
the marker's own. So the width is normal in its logarithm about that of the former marker, and so is the amplitude. A
tenth of the prior stays as it is, for a marker that has nothing in common with the former one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product

import numpy as np
from scipy.special import fresnel

from markerseek.core import Float64, MarkerCurve
from markerseek.search.curve import KNEES, log_curve

FRESNEL_NUMBERS: tuple[tuple[float, float], ...] = ((1.2, 0.04), (1.5, 0.04))
"""Fresnel number n at the centre of the band, and prior share, of each kind of curve with shoulders or two peaks."""

BAND = 0.2
"""Standard deviation of the band over its centre frequency."""

WIDTHS_DEG = np.exp(np.linspace(math.log(2.0), math.log(35.0), 30))
"""Full widths at half maximum, in degrees, evenly spaced in their logarithm."""

MODEL_ERROR: tuple[tuple[float, float], ...] = ((0.6, 0.035), (0.3, 0.1), (0.0, 0.2))
"""Relative error of a curve of the family, with the laser's jitter, where the curve exceeds this share of its peak."""

STEP_DEG = 0.05
"""Step of the tabulated curves, in degrees."""

LOG_WIDTH_SIGMA = 0.25
"""Standard deviation of ln F between two markers on one rig."""

LOG_PEAK_SIGMA = 0.5
"""Standard deviation of ln A between two markers on one rig."""

UNLIKE_SHARE = 0.1
"""Prior probability of a marker whose width has nothing in common with that of the former marker."""

_REACH_DEG = 100.0
"""Largest distance from the marker that is tabulated, in degrees; beyond it the curve stays as it is there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shapes:
    """Curves of the family, tabulated over the distance from the marker."""

    log_curve: Float64[np.ndarray, "shapes distances"]
    """ln S at distances of `STEP_DEG`."""
    fwhm_deg: Float64[np.ndarray, " shapes"]
    """Full width at half maximum of each."""
    log_prior: Float64[np.ndarray, " shapes"]
    """ln of the prior probability of each."""


def log_near_field(
    distance_deg: Float64[np.ndarray, " distances"], *, fwhm_deg: float, fresnel_number: float
) -> Float64[np.ndarray, " distances"]:
    """Return ln S of (2) at distances from the marker, for a marker in the near field of an element.

    ``distance_deg``: distances t, of either sign. ``fwhm_deg``: distance between the outermost angles at which S is
    half of S(0). ``fresnel_number``: Fresnel number n at the centre of the band.
    """
    across, log, half = _near_field(fresnel_number)
    return np.asarray(np.interp(2 * np.abs(distance_deg) / fwhm_deg * half, across, log))


@lru_cache(maxsize=8)
def _near_field(fresnel_number: float) -> tuple[Float64[np.ndarray, " across"], Float64[np.ndarray, " across"], float]:
    """Return distances in half heights of the element, ln S of (2) there, and the outermost one with half of S(0)."""
    # Fine where the peaks are, geometric in the tails.
    across = np.concatenate([np.linspace(0.0, 4.0, 801), np.geomspace(4.0, 130.0, 400)[1:]])
    power = np.zeros_like(across)
    # 13 frequencies within 1.5 standard deviations of the band, weighed by its Gaussian power.
    for away in np.linspace(-1.5, 1.5, 13).tolist():
        scale = math.sqrt(2 * fresnel_number * (1 + BAND * away))
        sine, cosine = np.add(fresnel(scale * (1 + across)), fresnel(scale * (1 - across)))
        power += math.exp(-(away**2) / 2) * (sine**2 + cosine**2)
    log = np.log(power / power[0]) / 2
    # The outermost crossing of half maximum: between the peaks the curve may fall below it, too.
    last = int(np.flatnonzero(log >= -math.log(2))[-1])
    half = float(np.interp(math.log(2), -log[last : last + 2], across[last : last + 2]))
    return across, log, half


@lru_cache(maxsize=1)
def family() -> Shapes:
    """Return the family with its prior.

    The widths of a probe's curves are 3–17° over the physics table; ln F is normal about ln 5.5° with a standard
    deviation of 0.6, and a fifth of the prior is uniform over all widths of `WIDTHS_DEG`.
    """
    distance_deg = np.arange(0.0, _REACH_DEG + STEP_DEG, STEP_DEG)
    # The uniform part allows widths that are not in the physics table.
    usual = np.exp(-((np.log(WIDTHS_DEG / 5.5) / 0.6) ** 2) / 2)
    width_share = 0.8 * usual / usual.sum() + 0.2 / WIDTHS_DEG.size
    kinds = [(partial(log_curve, tail=tail, knee=knee), share) for tail, knee, share in KNEES]
    kinds += [(partial(log_near_field, fresnel_number=number), share) for number, share in FRESNEL_NUMBERS]
    curves = []
    widths = []
    priors = []
    for (curve, share), (fwhm_deg, width) in product(
        kinds, zip(WIDTHS_DEG.tolist(), width_share.tolist(), strict=True)
    ):
        curves.append(np.maximum(curve(distance_deg, fwhm_deg=fwhm_deg), -12.0))
        widths.append(fwhm_deg)
        priors.append(math.log(share * width))
    # By columns: a grid asks for all shapes at one distance.
    return Shapes(log_curve=np.asfortranarray(curves), fwhm_deg=np.array(widths), log_prior=np.array(priors))


def shapes_with(shapes: Shapes, prior: MarkerCurve) -> Shapes:
    """Return the family of curves with the prior that a former marker gives, instead of its usual one."""
    usual = np.exp(shapes.log_prior)
    alike = usual * np.exp(-((np.log(shapes.fwhm_deg / prior.fwhm_deg) / LOG_WIDTH_SIGMA) ** 2) / 2)
    share = (1 - UNLIKE_SHARE) * alike / alike.sum() + UNLIKE_SHARE * usual / usual.sum()
    return replace(shapes, log_prior=np.log(share))


def log_amplitude_prior(prior: MarkerCurve, *, unit: float) -> tuple[float, float]:
    """Return mean and standard deviation of ln A over a unit of intensity."""
    return math.log(prior.peak / unit), LOG_PEAK_SIGMA
