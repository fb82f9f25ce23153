"""How far the middle of the intensity curve may lie from the marker.

The curve of a point is even. That of a stained spot is not: its absorbers interfere, and the middle of the curve lies
a tenth or two of a degree beside the middle of the spot; a tilted spot or tissue on the way shifts it as well. Samples
of one curve all agree on its middle, so that no number of them tells: it is a bias, and it has to be allowed for. The
marker is taken to be uneven with the probability `SHARE`, and the middle of an uneven marker's curve to be off by a
normal distribution of `OFFSET` times the curve's width.

Point and spot differ in what else they show. A point is heard from the same lateral position and equally coherently
at every angle (to 0.01 mm and 5 % over the physics table, at a wrong speed of sound or not); of a spot, different
absorbers may be heard at different angles. And the sound of most spots is not coherent over the aperture, whereas that
of a point is, unless it is focused with a wrong speed of sound. The probability is revised by all three.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from markerseek.core.reading import Sample
from markerseek.core.shapes import Float64

SHARE = 0.3
"""Prior probability of an uneven marker."""

OFFSET_DEG, OFFSET = 0.18, 0.012
"""Standard deviation of the offset of an uneven marker's curve, in degrees, and what it grows by with the full width at
half maximum, over that."""

STRONG = 12.0
"""Intensity over σ from which position and coherence tell."""

SAME_PLACE_M = 3e-3
"""Largest lateral distance between peaks of one marker, in metres."""

COHERENT = 0.95
"""Coherence, noise apart, of one in twenty spots or less and of one point in three or more."""

_COHERENT_ODDS, _ELSE_ODDS = math.log(0.05 / 0.35), math.log(0.95 / 0.65)
_LATERAL_M, _LATERAL_NOISE_M = 0.02e-3, 1.0e-3
_COHERENCE, _CHANNELS = 0.03, 60.0
_SCATTERS = np.array([0.0, 0.0, 0.0, 2.0, 6.0, 18.0])


def uneven_share(lit: Sequence[Sample], *, sigma: float, marker_m: float | None) -> float:
    """Return the probability that the marker is uneven, by how much its place and its coherence vary with the angle.

    Parameters
    ----------
    lit
        Samples with the laser on.
    sigma
        Noise of one quadrature, in the intensity's unit.
    marker_m
        Lateral position of the marker in metres; None if unknown.
    """
    places, coherences = [], []
    for sample in lit:
        reading, snr = sample.reading, sample.reading.intensity / sigma
        if snr < STRONG or marker_m is None:
            continue
        if reading.lateral_m is not None and abs(reading.lateral_m - marker_m) < SAME_PLACE_M:
            places.append((reading.lateral_m, math.hypot(_LATERAL_M, _LATERAL_NOISE_M / snr)))
            if reading.coherence is not None:
                # Noise takes its share of the channels' energy: so many channels are in the sum.
                noise = 2 * _CHANNELS / snr**2
                coherences.append((reading.coherence * (1 + noise), _COHERENCE + noise / 2))
    log_odds = math.log(SHARE / (1 - SHARE)) + _log_scatter(places) + _log_scatter(coherences)
    if coherences:
        weight = [1 / sigma**2 for _, sigma in coherences]
        level = sum(w * value for w, (value, _) in zip(weight, coherences, strict=True)) / sum(weight)
        log_odds += _COHERENT_ODDS if level > COHERENT else _ELSE_ODDS
    return 1 / (1 + math.exp(-min(max(log_odds, -30.0), 30.0)))


def _log_scatter(told: Sequence[tuple[float, float]]) -> float:
    """Ln of the probability of values that scatter more than their σ, over that of values that scatter by it."""
    if len(told) < 2:
        return 0.0
    value, sigma = np.array(told).T
    variance = sigma**2 + (_SCATTERS[:, None] * sigma.min()) ** 2
    weight = 1 / variance
    mean = (weight @ value) / weight.sum(axis=1)
    # The mean is unknown and integrated out; squares count as Student's do, for one bad frame.
    squares = (value - mean[:, None]) ** 2 / variance
    log_density = -0.5 * (np.log(variance) + 5.0 * np.log1p(squares / 4)).sum(axis=1) - 0.5 * np.log(weight.sum(axis=1))
    return math.log(float(np.exp(np.minimum(log_density - log_density[0], 300.0)).mean()))


def offset(
    angle_deg: Float64[np.ndarray, " angles"],
    share: Float64[np.ndarray, " angles"],
    middles_deg: Float64[np.ndarray, " middles"],
    *,
    uneven: float,
    sigma_deg: float,
) -> Float64[np.ndarray, " middles"]:
    """Return the density of the marker's angle, from that of the middle of its curve.

    Parameters
    ----------
    angle_deg, share
        Middles of the curve, evenly spaced, and the probability of each.
    middles_deg
        Angles of the marker at which it is wanted, in degrees.
    uneven
        Probability that the two differ.
    sigma_deg
        Standard deviation of the difference if they do, in degrees.
    """
    step_deg = float(angle_deg[1] - angle_deg[0])
    same = np.interp(middles_deg, angle_deg, share / step_deg, left=0.0, right=0.0)
    away = (middles_deg[:, None] - angle_deg) / sigma_deg
    spread = np.exp(-(away**2) / 2) @ share / (sigma_deg * math.sqrt(2 * math.pi))
    return np.asarray((1 - uneven) * same + uneven * spread)
