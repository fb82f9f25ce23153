"""How far the centre of the intensity curve may lie from the marker: a nuisance parameter of asymmetric markers.

The curve of a point is symmetric. That of a stained spot is not: its absorbers interfere, and the centre of the curve
lies some tenths of a millimetre beside the centroid of the spot; tissue on the way shifts it as well. All
samples of one curve share its centre, so that more of them do not show the shift: it is a bias, and the posterior is
widened by it,

    p(θ) = (1 − u)·q(θ) + u·∫ q(θ') N(θ − θ'; 0, (a/ρ)²) dθ',                                                 (10)

with q the posterior of the centre, u the probability that the marker is asymmetric (`PRIOR` before any sample), and the
standard deviation of its shift a/ρ from a = `SHIFT_M` at the marker's distance ρ from the axis.

Point and spot differ in what else they show. The lateral position and the coherence of a point are the same at every
angle (to 0.55 mm over the SNR, five times that where a pulse of half a microsecond leaves low frequencies only; and to
5 %, at a wrong speed of sound or not); of a spot, different absorbers may dominate at different angles. And the sound
of most spots is not coherent over the aperture, whereas that of a point is, unless it is focused with a wrong speed of
sound. The three of them revise u by Bayes' rule, their ln odds at half of their weight: the samples of one spot scatter
together, and those of many points scatter more than noise says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from markerseek.core import Float64, Reading, Sample

PRIOR = 0.3
"""Prior probability of an asymmetric marker."""

SHIFT_M = 0.25e-3
"""Standard deviation of the shift of an asymmetric marker's curve, in metres: the most likely one of 360 simulated
spots of 0.4 to 1.2 mm radius, 0.19 mm of the smallest and 0.29 mm of the largest, whatever the curve's width."""

EVIDENCE_SHARE = 0.5
"""Weight of the ln odds of the samples: of 560 simulated points and spots it gave their kind the mean ln probability
−0.40; a weight of 1 gave −0.45."""

USUAL_RADIUS_M = 55e-3
"""Distance of the marker from the axis in metres, where frames do not say it."""

FACE_RADIUS_M = 10e-3
"""Distance of the array's face from the axis in metres, the middle of the physics table."""

COHERENCE_SNR = 12.0
"""Intensity over σ from which lateral position and coherence are compared."""

SAME_PLACE_M = 3e-3
"""Largest lateral distance between peaks of one marker, in metres."""

COHERENT = 0.95
"""Coherence, noise apart, of one in twenty spots or less and of one point in three or more."""

_COHERENT_ODDS, _INCOHERENT_ODDS = math.log(0.05 / 0.35), math.log(0.95 / 0.65)
_LATERAL_M, _LATERAL_NOISE_M, _LONG_S = 10e-6, 0.55e-3, 420e-9
_COHERENCE, _CHANNELS = 0.03, 60.0
_SCATTERS = np.array([0.0, 0.0, 0.0, 2.0, 6.0, 18.0])


def shift_sigma_deg(*, depth_m: float | None) -> float:
    """Standard deviation of the shift of an asymmetric marker's curve, in degrees.

    Parameters
    ----------
    depth_m
        Distance of the marker from the array's face in metres; None if unknown.
    """
    radius_m = USUAL_RADIUS_M if depth_m is None else FACE_RADIUS_M + depth_m
    return math.degrees(SHIFT_M / radius_m)


def _lateral_sigma_m(reading: Reading, snr: float) -> float:
    """Standard deviation of the lateral position of a point's peak, in metres."""
    # The sound of a long pulse has low frequencies only, whose peak is wide along the array.
    long = max(1.0, ((reading.spread_s or 0.0) / _LONG_S) ** 4)
    return math.hypot(_LATERAL_M, _LATERAL_NOISE_M * long / snr)


def asymmetry_probability(lit: Sequence[Sample], *, sigma: float, marker_m: float | None) -> float:
    """Return u of (10), by how much lateral position and coherence vary with the angle.

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
        if snr < COHERENCE_SNR or marker_m is None:
            continue
        if reading.lateral_m is not None and abs(reading.lateral_m - marker_m) < SAME_PLACE_M:
            places.append((reading.lateral_m, _lateral_sigma_m(reading, snr)))
            if reading.coherence is not None:
                # Noise has a share of the channels' energy that grows with the number of channels in the sum.
                noise = 2 * _CHANNELS / snr**2
                coherences.append((reading.coherence * (1 + noise), _COHERENCE + noise / 2))
    # Bayes' rule in log-odds: the prior, and the Bayes factors of position, coherence and its level.
    evidence = _log_scatter(places) + _log_scatter(coherences)
    if coherences:
        weight = [1 / sigma**2 for _, sigma in coherences]
        level = sum(w * value for w, (value, _) in zip(weight, coherences, strict=True)) / sum(weight)
        evidence += _COHERENT_ODDS if level > COHERENT else _INCOHERENT_ODDS
    log_odds = math.log(PRIOR / (1 - PRIOR)) + EVIDENCE_SHARE * evidence
    return 1 / (1 + math.exp(-min(max(log_odds, -30.0), 30.0)))


def _log_scatter(values: Sequence[tuple[float, float]]) -> float:
    """Ln of the Bayes factor of values (each with its σ) that scatter by more than σ, over values that scatter by σ."""
    if len(values) < 2:
        return 0.0
    value, sigma = np.array(values).T
    # The additional scatter has a discrete prior: none for half of the spots, else 2, 6 or 18 times the best σ.
    variance = sigma**2 + (_SCATTERS[:, None] * sigma.min()) ** 2
    weight = 1 / variance
    mean = (weight @ value) / weight.sum(axis=1)
    # The mean is unknown and integrated out; residuals are Student's (4 degrees of freedom), for one outlier.
    squares = (value - mean[:, None]) ** 2 / variance
    log_density = -0.5 * (np.log(variance) + 5.0 * np.log1p(squares / 4)).sum(axis=1) - 0.5 * np.log(weight.sum(axis=1))
    return math.log(float(np.exp(np.minimum(log_density - log_density[0], 300.0)).mean()))


def shifted_density(
    angle_deg: Float64[np.ndarray, " centres"],
    share: Float64[np.ndarray, " centres"],
    markers_deg: Float64[np.ndarray, " angles"],
    *,
    probability: float,
    sigma_deg: float,
) -> Float64[np.ndarray, " angles"]:
    """Return the density of the marker's angle, (10), from the probabilities of the centre of its curve.

    Parameters
    ----------
    angle_deg, share
        Centres of the curve in degrees, evenly spaced, and the probability of each.
    markers_deg
        Angles of the marker at which the density is wanted, in degrees.
    probability
        u: probability that the marker is asymmetric.
    sigma_deg
        Standard deviation of the shift if it is, in degrees.
    """
    step_deg = float(angle_deg[1] - angle_deg[0])
    # The convolution of (10) is a sum over the grid of centres, a few hundred by some dozens.
    same = np.interp(markers_deg, angle_deg, share / step_deg, left=0.0, right=0.0)
    away = (markers_deg[:, None] - angle_deg) / sigma_deg
    shifted = np.exp(-(away**2) / 2) @ share / (sigma_deg * math.sqrt(2 * math.pi))
    return np.asarray((1 - probability) * same + probability * shifted)
