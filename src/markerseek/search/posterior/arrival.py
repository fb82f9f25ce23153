"""What the moment of arrival says about the angle.

With t = θ − θp, sound from a marker at radius ρ reaches a face at radius R after

    τ(t) = τ₀ + (sqrt(R² + ρ² − 2Rρ cos t) − (ρ − R))/c,

which is r² = A − C cos θ − S sin θ in other words. τ₀ holds the unknown trigger offset and is marginalised on a grid,
as is R; ρ follows from R and the depth, to which c is known well enough. What is read is the moment of the largest
envelope, and that hops: a long laser pulse has two edges (± `PULSE_S`), and off plane each edge of the element is
heard by itself, ± h sin φ/2c, φ the incidence. Over the physics table this scatter exceeds the signal itself within
20°, so that the cue is weak: it is told as it is, by a Student distribution of that scale.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

FACE_RADII_M = np.array([8e-3, 9.5e-3, 11e-3, 12.5e-3])
"""Distances R of the face from the axis that are considered, in metres."""

SOUND_SPEED_M_S = 1525.0
"""Middle of the speeds of the physics table."""

PULSE_S = 0.2e-6
"""Scatter of the largest envelope within a pulse, in seconds."""

EDGE_M = 2.0e-3
"""Half of an element's height, in metres."""

FREEDOM = 4.0
"""Degrees of freedom of the Student distribution."""

FIRST_S = np.arange(-40, 41, 2) * 25e-9
"""Places of τ₀ about the arrival of the strongest sample, in seconds."""


def delay_s(
    distance_deg: Float64[np.ndarray, "*shape"], *, face_radius_m: Float64[np.ndarray, "*shape"] | float, depth_m: float
) -> Float64[np.ndarray, "*shape"]:
    """Return how much later sound arrives off plane than on it, in seconds.

    Parameters
    ----------
    distance_deg
        Angles t off plane, in degrees.
    face_radius_m
        Distance R of the face from the axis, in metres.
    depth_m
        Distance of the marker from the face on plane, in metres.
    """
    radius_m = face_radius_m + depth_m
    cosine = np.cos(np.radians(distance_deg))
    range_m = np.sqrt(face_radius_m**2 + radius_m**2 - 2 * face_radius_m * radius_m * cosine)
    return np.asarray((range_m - depth_m) / SOUND_SPEED_M_S)


def log_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    heard_deg: Float64[np.ndarray, " samples"],
    arrival_s: Float64[np.ndarray, " samples"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of the arrivals for each angle of the marker, R and τ₀ marginalised.

    Parameters
    ----------
    angles_deg
        Angles of the marker that are considered, in degrees.
    heard_deg, arrival_s
        Angles in degrees and arrivals in seconds of samples whose peak is the marker's.
    snr
        Their intensities over σ.
    """
    reference_s = float(arrival_s[np.argmax(snr)])
    depth_m = max(SOUND_SPEED_M_S * reference_s, 5e-3)
    total = np.zeros((angles_deg.size, FACE_RADII_M.size, FIRST_S.size))
    for angle_deg, moment_s, height in zip(heard_deg.tolist(), arrival_s.tolist(), snr.tolist(), strict=True):
        off_deg = angle_deg - angles_deg[:, None]
        late_s = delay_s(off_deg, face_radius_m=FACE_RADII_M, depth_m=depth_m)
        edge_s = EDGE_M * np.sin(np.radians(np.minimum(1.2 * np.abs(off_deg), 90.0))) / SOUND_SPEED_M_S
        scale = np.sqrt(PULSE_S**2 + edge_s**2 + (0.1e-6 / height) ** 2)[..., None]
        missed = (moment_s - reference_s - late_s[..., None] - FIRST_S) / scale
        total -= np.log(scale) + (FREEDOM + 1) / 2 * np.log1p(missed**2 / FREEDOM)
    largest = float(total.max())
    return np.asarray(largest + np.log(np.mean(np.exp(total - largest), axis=(1, 2)) + math.exp(-60.0)))
