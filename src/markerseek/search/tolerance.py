"""The tolerance of an angle: the 95 % interval of a `Found` reaches no further from it than the user tolerates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from markerseek.core import Found, Sample, Tolerance

FACE_RADIUS_M = 10e-3
"""Middle of the distances R of the face from the axis in the physics table, in metres."""

KNOWN_SIGMA_DEG = 0.25
"""Standard deviation at which the centre of a curve counts as known while a search decides what to do next, in degrees.

What the user tolerates has nothing to do with it: beside a centre that is known worse, other sources are not judged."""


def marker_radius_m(lit: Sequence[Sample]) -> float | None:
    """Distance of the marker from the axis in metres, by the depth of the strongest sample; None if it has none."""
    depth_m = max(lit, key=lambda sample: sample.reading.intensity).reading.depth_m
    return None if depth_m is None else FACE_RADIUS_M + depth_m


def half_width_deg(found: Found) -> float:
    """How far the 95 % interval reaches from the angle, to the further side, in degrees."""
    return max(found.mean_deg - found.interval95_deg.low_deg, found.interval95_deg.high_deg - found.mean_deg)


def with_half_width(found: Found, *, radius_m: float | None) -> Found:
    """The answer with its half-width as a length at the marker, where its radius is known."""
    return found if radius_m is None else replace(found, half_width_m=radius_m * math.radians(half_width_deg(found)))


def beyond_tolerance(found: Found, tolerance: Tolerance, *, radius_m: float | None) -> str | None:
    """How well the angle is known, in words, where that is not within the tolerance; None if it is."""
    half_deg = half_width_deg(found)
    if half_deg <= tolerance.half_width_deg(radius_m):
        return None
    if radius_m is None:
        return f"the angle is known to within {half_deg:.2g} deg, and {tolerance.deg:g} deg are tolerated"
    half_mm = 1e3 * radius_m * math.radians(half_deg)
    return f"the angle is known to within {half_mm:.2g} mm at the marker, and {tolerance.mm:g} mm is tolerated"
