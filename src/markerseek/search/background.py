"""The background of a curve: intensity that is there at all angles, whatever the marker does.

A table of intensities may lie on a level: an offset of its amplifier, an artefact that is seen at all angles, the mean
of a noise that is not stated. A level is not a scatter. Taken for noise it hides the marker; taken for a signal it is
a strong source at all angles. So the level is an unknown of the curve,

    y(θ) = b + c·θ + A·S(θ − θp) + noise,

and is estimated before the rest: by a straight line through the samples that exceed no other by more than noise. What
is left is symmetric about the marker as before, also where the line takes a part of the curve's tails away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import overload

import numpy as np

from markerseek.core import Float64
from markerseek.search.curve import KNEES, Curve, log_curve, lower_quartile

LEVEL_OVER_SCATTER = 12.0
"""Lower quartile over the scatter from which noise does not explain it: that of the largest of 2,000 Rayleigh cells."""

_WIDTHS_DEG = tuple(np.geomspace(2.0, 70.0, 25).tolist())
"""Full widths at half maximum of the curves that are compared, in degrees: also wider than those of the posterior."""

LEAST_LOG = -12.0
"""ln of the lowest height of a curve that is compared: far below, a Gaussian is zero."""

FLAT_SHARE = 0.1
"""A curve that falls by no more than this share of its largest sample is flat: background, no marker."""

MAX_COMPARED = 150
CENTRES = 25
"""Samples, and angles of a marker, at which curves are compared with the samples at most."""

TOP_ERROR = 0.07
_TAIL_ERROR = 0.2
"""Relative differences from a curve of the family up to which it explains samples: root mean square at the top, and
elsewhere."""

_FAR_TAIL_ERROR = 0.01
"""Difference over the highest sample that counts nowhere (`likelihood.FAR_TAIL_ERROR`)."""

MOST = 0.85
"""Share of the samples beside the top that it has to explain: others are of another source."""

FEWEST_LOW = 6
"""Samples that a sloping background needs."""

MAX_FITS = 10
"""How often the line is fitted at most."""

KEPT_SIGMAS = 2.0
"""Standard deviations above the line from which a sample is of the marker, and not of the background."""

LEAST_END = 1 / 3
"""Least background at one end of the range over that at the other: the tail of a marker falls further."""

LOW_SHARE = 0.05
"""Share of the samples whose distance below the background says how uneven it is."""

LOW_SIGMAS = 3.0
"""Most standard deviations of noise by which this share lies below a line that fits."""

NOISE_DEPTH = 1.5
"""Square of that distance over the variance of noise, with some room: of normal noise it is 0.94."""

UNEVEN = 3.0
"""Unevenness over that distance: of what is spread evenly, the distance below the quartile is a third of the rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Background:
    """A straight line over the angle."""

    middle_deg: float
    """Middle of the angles, in degrees."""
    level: float
    """Intensity there."""
    slope_per_deg: float = 0.0
    """Change of the intensity with a degree."""

    @overload
    def at(self, angle_deg: float) -> float: ...
    @overload
    def at(self, angle_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]: ...
    def at(self, angle_deg: float | Float64[np.ndarray, " angles"]) -> float | Float64[np.ndarray, " angles"]:
        """Return the intensity at an angle, in degrees."""
        return self.level + self.slope_per_deg * (angle_deg - self.middle_deg)


def background_of(curve: Curve, *, scatter: float) -> Background | None:
    """Return the background of a curve.

    None if noise of that scatter explains the lowest samples, or the tails of a marker's own curve.
    """
    middle_deg = float(curve.angle_deg[0] + curve.angle_deg[-1]) / 2
    even = Background(middle_deg=middle_deg, level=lower_quartile(curve))
    if even.level <= LEVEL_OVER_SCATTER * scatter or _is_explained(curve, lowest=even.level, scatter=scatter):
        return None
    sloping = _sloping(curve, middle_deg=middle_deg, scatter=scatter)
    if sloping is None:
        return even
    ends = sorted(sloping.at(angle_deg) for angle_deg in (float(curve.angle_deg[0]), float(curve.angle_deg[-1])))
    # A line below the tail of a wide curve is a chord: samples lie below it.
    fits = _depth(curve, sloping) < max(LOW_SIGMAS * scatter, _depth(curve, even))
    return sloping if fits and ends[0] > LEAST_END * ends[1] else even


def background_sigma(curve: Curve, background: Background, *, scatter: float) -> float:
    """Return the standard deviation of a sample of the background: its scatter, and what the line does not follow."""
    depth = max(0.0, _depth(curve, background))
    noise_depth = math.sqrt(NOISE_DEPTH) * scatter
    # The difference of their squares, which may be no finite numbers.
    beyond = math.sqrt(max(0.0, depth - noise_depth)) * math.sqrt(depth + noise_depth)
    return math.hypot(scatter, UNEVEN * beyond)


def _is_explained(curve: Curve, *, lowest: float, scatter: float) -> bool:
    """Return whether a curve of the family that goes through the highest samples goes through most others as well.

    ``lowest``: intensity of the lowest ones.
    """
    largest = float(curve.intensity.max())
    if largest - lowest <= FLAT_SHARE * largest:
        return False
    some = np.union1d(np.linspace(0, len(curve) - 1, MAX_COMPARED).astype(np.int64), curve.strongest)
    angle_deg = curve.angle_deg[some]
    # Relative to the largest one: squares of intensities in an unknown unit may be no finite numbers.
    intensity = curve.intensity[some] / largest
    lowest = lowest / largest
    scatter = scatter / largest
    top = intensity > (1 + lowest) / 2
    if top.all():
        return True
    beside_deg = float(np.diff(angle_deg).max())
    centres_deg = np.linspace(angle_deg[top].min() - beside_deg, angle_deg[top].max() + beside_deg, CENTRES)
    away_deg = angle_deg - centres_deg[:, None]
    shapes = np.array(
        [
            np.exp(np.maximum(log_curve(away_deg, fwhm_deg=fwhm_deg, tail=tail, knee=knee), LEAST_LOG))
            for (tail, knee, _), fwhm_deg in product(KNEES, _WIDTHS_DEG)
        ]
    )
    # Least squares of the relative differences at the top.
    ratio = shapes[..., top] / intensity[top]
    height = shapes * (ratio.sum(axis=-1) / (ratio**2).sum(axis=-1))[..., None]
    off = np.abs(intensity - height)
    fits_top = np.sqrt(((off[..., top] / intensity[top]) ** 2).mean(axis=-1)) <= TOP_ERROR
    beyond = off[..., ~top] - _TAIL_ERROR * height[..., ~top]
    fits_rest = np.quantile(beyond, MOST, axis=-1) <= math.hypot(scatter, _FAR_TAIL_ERROR)
    return bool((fits_top & fits_rest).any())


def _depth(curve: Curve, background: Background) -> float:
    """Return how far the lowest samples lie below a background."""
    return -float(np.quantile(curve.intensity - background.at(curve.angle_deg), LOW_SHARE))


def _sloping(curve: Curve, *, middle_deg: float, scatter: float) -> Background | None:
    """Return the line through the lowest samples; None if they are too few."""
    away_deg = curve.angle_deg - middle_deg
    kept = curve.intensity <= np.median(curve.intensity)
    slope_per_deg = 0.0
    for _ in range(MAX_FITS):
        place_deg = away_deg[kept] - away_deg[kept].mean() if kept.any() else away_deg[:0]
        square = float(place_deg @ place_deg)
        if kept.sum() < FEWEST_LOW or not square > 0:
            return None
        slope_per_deg = float(place_deg @ curve.intensity[kept]) / square
        level = float(curve.intensity[kept].mean()) - slope_per_deg * float(away_deg[kept].mean())
        rest = curve.intensity - level - slope_per_deg * away_deg
        spread = max(scatter, 1.4826 * float(np.median(np.abs(rest[kept]))))
        former = kept
        kept = rest < KEPT_SIGMAS * spread
        if (former == kept).all():
            break
    level = lower_quartile(replace(curve, intensity=curve.intensity - slope_per_deg * away_deg))
    return Background(middle_deg=middle_deg, level=level, slope_per_deg=slope_per_deg)
