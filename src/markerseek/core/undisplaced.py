"""Samples of a marker that moves, as they would be if it had rested: what cameras saw of its motion is taken out.

An intensity depends on the angle between probe and marker. So a sample at θ while the marker was displaced by δ along
the turn is one at θ − δ/ρ, with ρ the distance of the marker from the axis. The displacement along the axis moves its
lateral position in the frame, and that away from the axis the range from which the sound comes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from markerseek.core.displacement import Displacement
from markerseek.core.reading import Reading, Sample
from markerseek.core.vectors import Vector

USUAL_FACE_RADIUS_M = 10e-3
"""Middle of the distances R of the face from the axis in the physics table, in metres."""

USUAL_SOUND_SPEED_M_S = 1525.0
"""Middle of the speeds of sound that studies draw (`markerseek.studies.unknowns`), in m/s."""

_NEAR_DEG = 8.0
"""Distance from the strongest sample up to which others tell where the marker is, about the width of a curve."""

_USUAL_DEPTH_M = 45e-3
"""Distance of a marker from the face, where no frame tells it."""

_MIN_OTHERS = 3
"""Known displacements from which one that is not known is taken for their mean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplacementSigmas:
    """Standard deviations of the error of a displacement, in metres."""

    turn_m: float
    lateral_m: float
    depth_m: float
    """``turn_m``, ``lateral_m`` and ``depth_m``: along the turn, along the axis, and away from it."""


def displacement_sigmas(sample: Sample) -> DisplacementSigmas:
    """Return how well the displacement of a sample is known; 0 where cameras saw none."""
    displacement = sample.displacement
    if displacement is None:
        return DisplacementSigmas(turn_m=0.0, lateral_m=0.0, depth_m=0.0)
    angle = math.radians(sample.angle_deg)
    directions = ((math.cos(angle), 0.0, -math.sin(angle)), (0.0, 1.0, 0.0), (math.sin(angle), 0.0, math.cos(angle)))
    turn_m, lateral_m, depth_m = (_sigma_m(displacement, each) for each in directions)
    return DisplacementSigmas(turn_m=turn_m, lateral_m=lateral_m, depth_m=depth_m)


def _sigma_m(displacement: Displacement, direction: Vector) -> float:
    """Return the standard deviation along a unit vector."""
    products = (
        one * other * covariance_mm2
        for one, row in zip(direction, displacement.covariance_mm2, strict=True)
        for other, covariance_mm2 in zip(direction, row, strict=True)
    )
    return 1e-3 * math.sqrt(max(sum(products), 0.0))


def undisplaced(samples: Sequence[Sample], *, face_radius_m: float = USUAL_FACE_RADIUS_M) -> list[Sample]:
    """Return the samples of a search as they would be with the tissue at rest.

    What is left of a displacement is none, with the error that it had. A displacement that is not known is taken for
    the mean of the others, with their scatter as its error, where enough are known.

    ``face_radius_m``: distance of the array's face from the axis.
    """
    if all(sample.displacement is None for sample in samples):
        return list(samples)
    usual = _usual(samples)
    about_deg, depth_m = _place(samples)
    return [
        sample
        if sample.dark or (displacement := sample.displacement or usual) is None
        else _undisplaced(
            sample, displacement, about_deg=about_deg, radius_m=face_radius_m + depth_m, face_radius_m=face_radius_m
        )
        for sample in samples
    ]


def _usual(samples: Sequence[Sample]) -> Displacement | None:
    """Return the mean of the displacements that are known, with their scatter in its covariance."""
    known = [each.displacement for each in samples if each.displacement is not None]
    if len(known) < _MIN_OTHERS:
        return None
    count = len(known)
    mean = [sum(each.mm[axis] for each in known) / count for axis in range(3)]

    def covariance_mm2(one: int, other: int) -> float:
        """Return the mean covariance of the displacements, and of their scatter."""
        products = (
            each.covariance_mm2[one][other] + (each.mm[one] - mean[one]) * (each.mm[other] - mean[other])
            for each in known
        )
        return sum(products) / count

    first, second, third = (
        (covariance_mm2(axis, 0), covariance_mm2(axis, 1), covariance_mm2(axis, 2)) for axis in range(3)
    )
    return Displacement(mm=(mean[0], mean[1], mean[2]), covariance_mm2=(first, second, third))


def _place(samples: Sequence[Sample]) -> tuple[float, float]:
    """Return about where the strongest source is: its angle, and its depth."""
    strongest = max((each for each in samples if not each.dark), key=lambda each: each.reading.intensity)
    near = [
        (each.reading.intensity**2, each.angle_deg)
        for each in samples
        if not each.dark and abs(each.angle_deg - strongest.angle_deg) <= _NEAR_DEG
    ]
    total = sum(weight for weight, _ in near)
    about_deg = sum(weight * angle_deg for weight, angle_deg in near) / total if total > 0 else strongest.angle_deg
    depth_m = strongest.reading.depth_m
    return about_deg, _USUAL_DEPTH_M if depth_m is None else depth_m


def _undisplaced(
    sample: Sample, displacement: Displacement, *, about_deg: float, radius_m: float, face_radius_m: float
) -> Sample:
    """Return one sample with the marker at rest, about this angle and at this distance from the axis."""
    angle = math.radians(about_deg)
    along_x, along_axis, along_z = (1e-3 * each for each in displacement.mm)
    x_m = radius_m * math.sin(angle) + along_x
    z_m = radius_m * math.cos(angle) + along_z
    turned_deg = math.degrees(math.atan2(x_m, z_m)) - about_deg
    # The angle between probe and marker is the same in both.
    between = math.radians(sample.angle_deg - turned_deg - about_deg)
    further_m = _range_m(math.hypot(x_m, z_m), between, face_radius_m) - _range_m(radius_m, between, face_radius_m)
    return replace(
        sample,
        angle_deg=sample.angle_deg - turned_deg,
        reading=_moved(sample.reading, lateral_m=-along_axis, further_m=-further_m),
        displacement=Displacement(mm=(0.0, 0.0, 0.0), covariance_mm2=displacement.covariance_mm2),
    )


def _range_m(radius_m: float, between: float, face_radius_m: float) -> float:
    """Return the distance of a source from the face, the probe turned away from it by an angle."""
    return math.sqrt(radius_m**2 + face_radius_m**2 - 2 * radius_m * face_radius_m * math.cos(between))


def _moved(reading: Reading, *, lateral_m: float, further_m: float) -> Reading:
    """Return a reading whose sources all lie elsewhere: along the array, and further away."""
    later_s = further_m / USUAL_SOUND_SPEED_M_S
    spot = reading.spot
    if spot is not None:
        spot = replace(spot, lateral_m=spot.lateral_m + lateral_m, depth_m=spot.depth_m + further_m)
    maxima = reading.local_maxima
    if maxima is not None:
        maxima = replace(
            maxima,
            first_lateral_m=maxima.first_lateral_m + lateral_m,
            first_depth_m=maxima.first_depth_m + further_m,
        )
    return replace(
        reading,
        lateral_m=_sum(reading.lateral_m, lateral_m),
        depth_m=_sum(reading.depth_m, further_m),
        arrival_s=_sum(reading.arrival_s, later_s),
        centroid_s=_sum(reading.centroid_s, later_s),
        spot=spot,
        arrivals=tuple(
            replace(
                each,
                lateral_m=each.lateral_m + lateral_m,
                depth_m=each.depth_m + further_m,
                arrival_s=each.arrival_s + later_s,
            )
            for each in reading.arrivals
        ),
        local_maxima=maxima,
    )


def _sum(value: float | None, by: float) -> float | None:
    return None if value is None else value + by
