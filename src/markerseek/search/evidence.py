"""Tests of an answer: evidence for a marker, samples that contradict the answer, and the tolerance of its angle.

A reading may be incomplete: each test uses the features that are there and ignores those that are None.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec.structs import replace

from markerseek.core import USUAL_FACE_RADIUS_M, Found, Interval, Sample, Tolerance
from markerseek.search.background import FLAT_SHARE
from markerseek.search.curve import curve_of
from markerseek.search.floor import SearchNoise

UNKNOWN_RATIO = 10.0
"""Where the floor is unknown, the largest sample must be this many times the smallest."""

FLAT_SIGMAS = 4.5
"""A curve that falls by no more than this many σ is flat: that is about the spread of tens of equal samples."""

_LATERAL_M = 3e-3
"""Largest lateral distance between strong samples of one marker; elements are 0.43 mm apart."""

_DEPTH_M = 4e-3
"""Largest distance in depth: off plane the slant range grows by 1.6 mm at 30° (physics notes)."""

REPEATED = 2
"""Other samples above the detection threshold at the position of the strongest that noise does not produce."""

CONSISTENT_SHARE = 0.8
"""Samples next to the answer must reach this share of the largest; noise-free unimodal curves do."""


def why_not_detected(lit: Sequence[Sample], *, dark: Sequence[Sample], noise: SearchNoise) -> str | None:
    """Return why the samples are no evidence of a marker, as a message; None if they are.

    ``lit``, ``noise``: above the background, where there is one.
    """
    if not lit:
        return "nothing has been measured yet"
    intensities = [sample.reading.intensity for sample in lit]
    strongest = lit[int(np.argmax(intensities))]
    largest = max(intensities)
    smallest = min(intensities)
    level = noise.floor.level
    if level is None:
        if not (largest > 0 and largest >= UNKNOWN_RATIO * smallest and len(lit) > 1):
            return (
                f"the detection threshold is unknown and the largest intensity, {largest:.4g}, is below "
                f"{UNKNOWN_RATIO:g} times the smallest, {smallest:.4g}; dark frames or 12 angles give it"
            )
    elif not largest > level:
        return (
            f"the largest intensity, {largest:.4g}, does not exceed the detection threshold, {level:.4g} "
            f"({noise.floor.source}{_above(noise)})"
        )
    if len(lit) == 1:
        return "only one angle has been measured; a peak shows beside others"
    base = 0.0 if noise.background is None else noise.background.level
    flat = largest - smallest <= max(FLAT_SHARE * (base + largest), FLAT_SIGMAS * noise.sigma_or_zero)
    # A weak marker that one or two angles show is no background: at the others there is nothing but noise.
    if flat and not (dark and np.median(intensities) <= max(sample.reading.intensity for sample in dark)):
        return (
            f"the intensity is the same at all measured angles, {base + smallest:.4g} to {base + largest:.4g}: there "
            "is no peak"
        )
    known = noise.level_or_zero
    return _elsewhere(lit, strongest, level=known) or _incoherent(lit, strongest, dark, level=known)


def _above(noise: SearchNoise) -> str:
    """Return what intensities are counted from, for a message; empty if from zero."""
    return "" if noise.background is None else f", both above a background of {noise.background.level:.4g}"


def _elsewhere(lit: Sequence[Sample], strongest: Sample, *, level: float) -> str | None:
    """Return why the strong samples are not of one source; None if most come from one position in the image."""
    # Only strong samples: the position of a weak one is pulled by noise.
    least = max(level, strongest.reading.intensity / 2)
    others = [sample for sample in lit if sample is not strongest and sample.reading.intensity >= least]
    for name, tolerance_m in (("lateral_m", _LATERAL_M), ("depth_m", _DEPTH_M)):
        here_m = getattr(strongest.reading, name)
        there_m = [place for sample in others if (place := getattr(sample.reading, name)) is not None]
        if here_m is None or not there_m:
            continue
        agreeing = sum(abs(place - here_m) <= tolerance_m for place in there_m)
        if 2 * agreeing < len(there_m):
            return (
                f"the strong samples come from different places: {len(there_m) - agreeing} of {len(there_m)} differ by "
                f"more than {1e3 * tolerance_m:g} mm in {name.removesuffix('_m')} from the strongest"
            )
    return None


def _incoherent(lit: Sequence[Sample], strongest: Sample, dark: Sequence[Sample], *, level: float) -> str | None:
    """Return why the strongest sample may be noise, as incoherent as dark frames and alone at its place; else None."""
    # A marker in tissue whose speed of sound is not the preset's may be no more coherent than a noise peak; but noise,
    # or a spike on a channel, does not come from one place again and again.
    coherence = strongest.reading.coherence
    noise = [sample.reading.coherence for sample in dark if sample.reading.coherence is not None]
    if coherence is None or not noise or coherence > max(noise):
        return None
    if sum(_same_position(sample, strongest) for sample in lit if sample.reading.intensity > level) > REPEATED:
        return None
    return f"the strongest sample is no more coherent, {coherence:.2g}, than the dark ones, {max(noise):.2g}"


def _same_position(sample: Sample, other: Sample) -> bool:
    """Return whether two samples are known to come from the same place in the image."""
    here = sample.reading
    there = other.reading
    if here.lateral_m is None or there.lateral_m is None or here.depth_m is None or there.depth_m is None:
        return False
    return abs(here.lateral_m - there.lateral_m) <= _LATERAL_M and abs(here.depth_m - there.depth_m) <= _DEPTH_M


def rising_side(lit: Sequence[Sample], *, answer: Found, limits: Interval) -> Literal["low", "high"] | None:
    """Return the end of the range at which the intensity still rises; None if at none.

    A sweep rises at an end if its strongest sample is the outermost, and nearer to the end than three quarters of the
    way to its neighbour. A bracket rises there if it was never cut on that side and the strongest sample is the
    outermost.
    """
    curve = curve_of(lit)
    top = curve.strongest
    if len(curve) < 2 or top not in (0, len(curve) - 1):
        return None
    side: Literal["low", "high"] = "low" if top == 0 else "high"
    if answer.interval_kind == "bracket":
        uncut = (
            answer.interval95_deg.low_deg <= limits.low_deg
            if side == "low"
            else answer.interval95_deg.high_deg >= limits.high_deg
        )
        return side if uncut else None
    end_deg = limits.low_deg if side == "low" else limits.high_deg
    neighbour_deg = curve.angle_deg[1] if side == "low" else curve.angle_deg[-2]
    to_end_deg = abs(float(curve.angle_deg[top]) - end_deg)
    return side if to_end_deg <= 0.75 * abs(float(curve.angle_deg[top] - neighbour_deg)) else None


def inconsistency(
    lit: Sequence[Sample], *, mean_deg: float, noise: SearchNoise, relative_error: float = 0.0
) -> str | None:
    """Return why the answer does not fit the samples, in words; None if it does.

    Next to the maximum of a unimodal curve lies its largest sample or one nearly as large. An average that falls
    between two peaks, or a bracket that dropped the peak, has none.

    ``lit``, ``noise``: above the background, where there is one. ``relative_error``: standard deviation of a sample by
    the laser's energy, over its intensity.
    """
    curve = curve_of(lit)
    # The neighbours on both sides, and every sample at the angle itself.
    first, end = (int(np.searchsorted(curve.angle_deg, mean_deg, side=side)) for side in ("left", "right"))
    near = curve.intensity[max(0, first - 1) : end + 1]
    largest = float(curve.intensity[curve.strongest])
    spread = math.hypot(noise.sigma_or_zero, relative_error * largest)
    if near.max() >= CONSISTENT_SHARE * largest - 3 * spread:
        return None
    return (
        f"the samples next to the answer, at most {near.max():.4g}, are weaker than the one at "
        f"{curve.angle_deg[curve.strongest]:.2f} deg, {largest:.4g}{_above(noise)}"
    )


KNOWN_SIGMA_DEG = 0.25
"""Standard deviation at which the centre of a curve counts as known while a search decides what to do next, in degrees.

What the user tolerates has nothing to do with it: beside a centre that is known worse, other sources are not judged."""


def marker_radius_m(lit: Sequence[Sample]) -> float | None:
    """Return the distance of the marker from the axis in metres, by the depth of the strongest sample.

    None if it has none.
    """
    depth_m = max(lit, key=lambda sample: sample.reading.intensity).reading.depth_m
    return None if depth_m is None else USUAL_FACE_RADIUS_M + depth_m


def half_width_deg(found: Found) -> float:
    """Return how far the 95 % interval reaches from the angle, to the further side, in degrees."""
    return max(found.mean_deg - found.interval95_deg.low_deg, found.interval95_deg.high_deg - found.mean_deg)


def with_half_width(found: Found, *, radius_m: float | None) -> Found:
    """Return the answer with its half-width as a length at the marker, where its radius is known."""
    return found if radius_m is None else replace(found, half_width_m=radius_m * math.radians(half_width_deg(found)))


def beyond_tolerance(found: Found, tolerance: Tolerance, *, radius_m: float | None) -> str | None:
    """Return how well the angle is known, in words, where that is not within the tolerance; None if it is."""
    half_deg = half_width_deg(found)
    if half_deg <= tolerance.half_width_deg(radius_m):
        return None
    if radius_m is None:
        return f"the angle is known to within {half_deg:.2g} deg, and {tolerance.deg:g} deg are tolerated"
    half_mm = 1e3 * radius_m * math.radians(half_deg)
    return f"the angle is known to within {half_mm:.2g} mm at the marker, and {tolerance.mm:g} mm is tolerated"
