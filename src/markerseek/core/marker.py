"""Position of the marker in the TRUS frame, from a search's answer and its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markerseek.core.estimate import Found
from markerseek.core.facts import RigFacts
from markerseek.core.reading import Sample

STRONG_SHARE = 0.5
"""Least intensity over the strongest one's, from which a frame counts for the position."""

SAME_SOURCE_M = 3e-3
"""Largest distance, along the array and in depth, of its peak from the strongest one's: the widest stained spot."""

SCATTER_FACTOR = 2.0
"""Standard deviation of a position over its scatter from frame to frame. Frames of one search share most of the error:
a stained spot is uneven, and they all see its brightest part. On four simulated materials at 40 dB this ratio was 0.8
(phantom) to 2.2."""

USUAL_SCATTER_M = 0.03e-3
"""Scatter that is assumed beside the one seen, with the weight of one frame: two frames may agree by chance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerPosition:
    """Where the marker is.

    Attributes
    ----------
    position_m
        (x, y, z) in the TRUS frame, in metres: y along the axis of rotation, z out of the array at 0°.
    sigma_m
        Standard deviations along the turn (that of the angle), along the axis (lateral) and away from the axis
        (depth), in metres. Errors that all markers share, as that of the sound speed, are not in them.
    """

    position_m: tuple[float, float, float]
    sigma_m: tuple[float, float, float]


def marker_position(found: Found, samples: Sequence[Sample], facts: RigFacts) -> MarkerPosition | None:
    """Position of the marker; None where the frames give no position, or the face radius is not known.

    Lateral position and depth are means over the strong frames, weighted by the square of their intensity. The depth
    is that of the energy's centroid in time: a long laser pulse gives two peaks, and which is higher is chance.

    Parameters
    ----------
    found
        The answer.
    samples
        All samples with light, the confirmation among them.
    facts
        Face radius and sound speed of the rig.
    """
    face_m = facts.face_radius_m
    places = [place for sample in samples if (place := _place(sample, facts.sound_speed_m_s)) is not None]
    if face_m is None or not places:
        return None
    strongest = max(places, key=lambda place: place.intensity)
    strong = [place for place in places if _same_source(place, strongest)]
    weights = [place.intensity**2 for place in strong]
    lateral_m, along_m = _mean_and_sigma([place.lateral_m for place in strong], weights)
    radii_m = [_radius_m(place.depth_m, face_m, math.radians(place.angle_deg - found.mean_deg)) for place in strong]
    radius_m, deep_m = _mean_and_sigma(radii_m, weights)
    angle = math.radians(found.mean_deg)
    return MarkerPosition(
        position_m=(radius_m * math.sin(angle), lateral_m, radius_m * math.cos(angle)),
        sigma_m=(radius_m * math.radians(found.sigma_deg), along_m, deep_m),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Place:
    """Where a frame shows its strongest source."""

    angle_deg: float
    intensity: float
    lateral_m: float
    depth_m: float


def _place(sample: Sample, sound_speed_m_s: float | None) -> _Place | None:
    """Place of a sample, with the depth of the energy's centroid; that of the peak where the centroid is not known."""
    reading = sample.reading
    if reading.lateral_m is None or reading.depth_m is None:
        return None
    later_s = 0.0
    if reading.centroid_s is not None and reading.arrival_s is not None:
        # Both count from the trigger, so that its offset cancels.
        later_s = reading.centroid_s - reading.arrival_s
    depth_m = reading.depth_m + (sound_speed_m_s or 0.0) * later_s
    return _Place(angle_deg=sample.angle_deg, intensity=reading.intensity, lateral_m=reading.lateral_m, depth_m=depth_m)


def _same_source(place: _Place, strongest: _Place) -> bool:
    """Whether a place is strong, and near the strongest."""
    return (
        place.intensity >= STRONG_SHARE * strongest.intensity
        and abs(place.lateral_m - strongest.lateral_m) <= SAME_SOURCE_M
        and abs(place.depth_m - strongest.depth_m) <= SAME_SOURCE_M
    )


def _radius_m(slant_m: float, face_m: float, off_plane: float) -> float:
    """Distance from the axis: ρ of r² = R² + ρ² − 2 R ρ cos t, with the slant range r and the angle t off the plane."""
    across_m = face_m * math.sin(off_plane)
    return face_m * math.cos(off_plane) + math.sqrt(max(slant_m**2 - across_m**2, 0.0))


def _mean_and_sigma(values_m: Sequence[float], weights: Sequence[float]) -> tuple[float, float]:
    """Weighted mean, and its standard deviation from the scatter of the values."""
    total = sum(weights)
    mean_m = sum(weight * value for weight, value in zip(weights, values_m, strict=True)) / total
    scatter = sum(weight * (value - mean_m) ** 2 for weight, value in zip(weights, values_m, strict=True)) / total
    count = len(values_m)
    return mean_m, SCATTER_FACTOR * math.sqrt((count * scatter + USUAL_SCATTER_M**2) / (count + 1))
