"""How probable a reading is, given what the marker alone would give: one table for each sample.

The envelope at the marker's pixel is Rician, with μ the noise-free height and σ one quadrature of the noise; a relative
error ε of the model widens it to σ² + (εμ)². The image's largest peak is that pixel's or the largest E of M Rayleigh
cells elsewhere, whichever is higher (Rice 1945; order statistics):

    p(y|μ) = f_R(y|μ)·F_E(y)·g + f_E(y)·F_R(y|μ),       F_E(y) = (1 − exp(−y²/2σ²))^M,

where g compares how probable the peak's place is for the marker with how probable it is for noise: a marker stays at
its lateral position, noise is anywhere. F_R is taken as normal, which it is to a few per cent once y exceeds 3σ, as
the largest of M cells always does. One frame in a hundred is bad: it may hold anything over `SPOILT_RANGE` in ln y.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from markerseek.core.shapes import Float64
from markerseek.search.posterior import _kernel

LOW, HIGH, STEP = -6.0, 3.0, 0.02
"""Ends and step of the table in ln(μ/y)."""

_HEIGHTS = np.exp(np.arange(LOW, HIGH + STEP / 2, STEP))

HEIGHTS = _HEIGHTS.size
"""Places of the table."""

SPOILT = 0.01
"""Share of frames that say nothing of the marker."""

SPOILT_RANGE = 7.0
"""Range of ln y over which a spoilt frame is evenly spread."""

PLACE_SIGMA_M = 0.5e-3
"""Standard deviation of the lateral position of one marker's peak, a pitch at most; in metres."""

IMAGE_M = 55e-3
"""Width of the image, over which noise spreads its peaks, in metres."""


def place_ratio(lateral_m: float | None, *, marker_m: float | None) -> float:
    """Return g: the density of a peak's lateral position for the marker over that for noise; 1 where unknown.

    Parameters
    ----------
    lateral_m
        Where the peak is, in metres.
    marker_m
        Where the marker is known to be, in metres.
    """
    if lateral_m is None or marker_m is None:
        return 1.0
    away = (lateral_m - marker_m) / PLACE_SIGMA_M
    return max(IMAGE_M / (PLACE_SIGMA_M * math.sqrt(2 * math.pi)) * math.exp(-(away**2) / 2), 0.02)


@lru_cache(maxsize=512)
def log_tables(
    *, noise: float, cells: int, errors: tuple[float, ...], ratio: float = 1.0
) -> Float64[np.ndarray, "errors heights"]:
    """Return ln p(y|μ)·y over ln(μ/y) from `LOW` to `HIGH`, one row for each model error.

    Parameters
    ----------
    noise
        σ/y, positive.
    cells
        Number M of independent cells.
    errors
        Relative errors ε of the model.
    ratio
        g of `place_ratio`.
    """
    rayleigh = math.exp(-min(1 / (2 * noise**2), 700.0))
    below = math.exp(cells * math.log1p(-min(rayleigh, 1 - 1e-12)))
    largest = cells * rayleigh / noise**2 * below / max(1 - rayleigh, 1e-12)
    good = 1 - SPOILT
    tables = np.empty((len(errors), _HEIGHTS.size))
    _kernel.fill_tables(
        _HEIGHTS, noise, good * below * ratio, good * largest, SPOILT / SPOILT_RANGE, np.array(errors), tables
    )
    tables.flags.writeable = False
    return tables
