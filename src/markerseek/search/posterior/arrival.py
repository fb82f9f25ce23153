"""What the moments of arrival say about the angle: the centroid of a peak's energy in time, and its spread.

With t = θ − θp, sound from a marker at radius ρ reaches a face at radius R later by

    D(t) = (sqrt(R² + ρ² − 2Rρ cos t) − (ρ − R))/c

than on plane, which is r² = A − C cos θ − S sin θ in other words. Off plane an element is heard by its two edges,
h sin φ/c apart, φ the incidence. So centroid and variance of the energy in time are

    τ = τ₀ + (1 + k)·D(t) + δ·(1 − 1/(1 + (t/t₁)²)),        s² = a + b·sin² φ(t).

τ₀ holds the trigger offset, k what is not known of R and c; δ is how much later than the pulse on plane the edges are
heard, lens and all; a is the laser's and the absorber's pulse, b = (h/2c)². None of them is known: each has a broad
normal prior and is integrated out. About the model the moments of the acoustic model's own pulses scatter with the
tails of a Student distribution (150 draws of the physics table, 125 angles each); that, and the noise, is the scale.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core.compiled import compiled
from markerseek.core.shapes import Float64
from markerseek.search.posterior._student import student_evidence

FACE_RADIUS_M = 10e-3
"""Middle of the distances R of the face from the axis in the physics table, in metres."""

SOUND_SPEED_M_S = 1525.0
"""Middle of its speeds of sound."""

DELAY_SHARE = 0.16
"""Standard deviation of k: R of 8 to 12 mm and the speed of sound."""

LOBE_DEG = 3.5
"""t₁, where the sound of the face gives way to that of its edges, in degrees."""

EDGES_LATER_S = 0.1e-6
"""Standard deviation of δ, in seconds."""

HEIGHT_M2 = (20e-6, 10e-6)
"""Mean and standard deviation of the squared height h² of an element, 3 to 6 mm; in square metres."""

FREEDOM = 4.0
"""Degrees of freedom of the Student distributions."""

WEIGHT = 0.25
"""Power of the likelihood: the samples of one marker stray from the model alike, so that four count as one. Taken as
independent they outvote the intensities, by degrees, in one search of some hundred."""

_ROUNDS = 3


@compiled
def off_plane(
    distance_deg: Float64[np.ndarray, "*shape"], face_radius_m: float, depth_m: float
) -> tuple[Float64[np.ndarray, "*shape"], Float64[np.ndarray, "*shape"]]:
    """Return how much later sound arrives off plane than on it, in seconds, and the sine of its incidence.

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
    turned = np.radians(distance_deg)
    range_m = np.sqrt(face_radius_m**2 + radius_m**2 - 2 * face_radius_m * radius_m * np.cos(turned))
    return (range_m - depth_m) / SOUND_SPEED_M_S, radius_m * np.sin(turned) / range_m


def log_likelihood(
    angles_deg: Float64[np.ndarray, " angles"],
    heard_deg: Float64[np.ndarray, " samples"],
    moments_s: Float64[np.ndarray, "samples 2"],
    snr: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, " angles"]:
    """Return ln of the likelihood of the moments for each angle of the marker, all else integrated out.

    Parameters
    ----------
    angles_deg
        Angles of the marker that are considered, in degrees.
    heard_deg, moments_s
        Angles in degrees, and centroid and standard deviation in seconds, of samples whose peak is the marker's.
    snr
        Their intensities over σ.
    """
    reference_s = float(moments_s[np.argmax(snr), 0])
    shape = (angles_deg.size, heard_deg.size)
    when, spread = ((np.empty((*shape, terms)), np.empty(shape), np.empty(shape)) for terms in (3, 2))
    _fill_in(angles_deg, heard_deg, moments_s, snr, reference_s, *when, *spread)
    precision = np.array([1 / 50**2, 1 / DELAY_SHARE**2, 1.0])
    log = student_evidence(*when, precision, FREEDOM, _ROUNDS)
    log += student_evidence(*spread, np.array([1 / 30**2, 1.0]), FREEDOM, _ROUNDS)
    return np.asarray(WEIGHT * log)


@compiled
def _fill_in(
    angles_deg: Float64[np.ndarray, " angles"],
    heard_deg: Float64[np.ndarray, " samples"],
    moments_s: Float64[np.ndarray, "samples 2"],
    snr: Float64[np.ndarray, " samples"],
    reference_s: float,
    when: Float64[np.ndarray, "angles samples 3"],
    later: Float64[np.ndarray, "angles samples"],
    when_scale: Float64[np.ndarray, "angles samples"],
    spread: Float64[np.ndarray, "angles samples 2"],
    wide: Float64[np.ndarray, "angles samples"],
    wide_scale: Float64[np.ndarray, "angles samples"],
) -> None:
    """Fill in design, value and scale of the two linear models: of τ over δ's unit, and of s² over that of b."""
    depth_m = max(SOUND_SPEED_M_S * reference_s, 5e-3)
    height_m2, height_sd_m2 = HEIGHT_M2
    unit = height_m2 * (0.3 / (2 * SOUND_SPEED_M_S)) ** 2
    for k in range(angles_deg.size):
        for i in range(heard_deg.size):
            off_deg = heard_deg[i] - angles_deg[k]
            late_s, sine = off_plane(off_deg, FACE_RADIUS_M, depth_m)
            lobes = abs(off_deg) / LOBE_DEG
            when[k, i, 0] = 1.0
            when[k, i, 1] = late_s / EDGES_LATER_S
            when[k, i, 2] = 1 - 1 / (1 + lobes**2)
            later[k, i] = (moments_s[i, 0] - reference_s - late_s) / EDGES_LATER_S
            model_s = 15e-9 + 30e-9 * lobes * math.exp(1 - lobes)
            when_scale[k, i] = math.hypot(model_s, 0.22e-6 / snr[i]) / EDGES_LATER_S

            edges = (sine / (2 * SOUND_SPEED_M_S)) ** 2
            variance = moments_s[i, 1] ** 2
            spread[k, i, 0] = 1.0
            spread[k, i, 1] = height_sd_m2 * edges / unit
            wide[k, i] = (variance - height_m2 * edges) / unit
            model = 0.05 + 0.2 * height_m2 * edges / unit
            wide_scale[k, i] = math.hypot(model, 2.5 / snr[i] * (variance / unit))
