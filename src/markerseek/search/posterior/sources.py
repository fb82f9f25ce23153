"""Sources: arrivals of all frames joined by their place in the image, and each frame's reading at such a place.

A frame holds up to eight arrivals, and a source is at one place in all of them: at the same lateral position, and at a
depth that grows off the plane by c·D(t) of (4) at most. A second marker, clutter, and a repeat of the sound behind a
source are therefore sources of their own. Where a source has no arrival in a frame, the image at its place still says
how loud it can be: the largest envelope of a few cells instead of a hundred thousand, so that M of (3) is small there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from markerseek.core import Arrival, Reading, Sample
from markerseek.search.floor import FEWEST_CELLS

POINT_M = 1.5e-3
"""Largest distance between arrivals of one point along the array, in metres."""

SPOT_M, SPOT_DEG = 3e-3, 5.0
"""Places nearer than this along the array, and strongest at about the same angle, are one spot: stained spots are 2 to
3 mm wide. In metres and degrees."""

DEEP_M = 3e-3
"""Largest distance between arrivals of one source in depth, moveout apart, in metres: a long laser pulse arrives twice,
and a repeat of the sound comes 5 mm or more behind."""

NEAR_M = 0.5e-3
"""Half the width and the height of the place at which an image is looked up, in metres: a peak of the source lies
there, moveout apart."""

UNKNOWN_DEG = 10.0
"""Angle by which the strongest arrival may itself be off the plane, in degrees."""

LARGEST_FACE_RADIUS_M = 12e-3
"""Largest distance of the face from the axis in the physics table, in metres; the moveout grows with it."""

COVERED_M = 3.5e-3
"""Distance up to which another source's arrival may be in the blocks looked up, which are 2 mm wide and deep."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A source of sound, at one position in the image."""

    lateral_m: float
    depth_m: float
    """``lateral_m`` and ``depth_m``: place of its strongest arrival."""
    angle_deg: float
    """Angle of the probe at which that arrived."""
    intensity: float
    reach_m: float = POINT_M
    """Largest distance of its other arrivals along the array."""

    def distance_m(self, arrival: Arrival, *, angle_deg: float) -> float:
        """Distance of an arrival at this angle of the probe, moveout apart, in metres; infinite if it is too far."""
        aside_m, off_m = self._away_m(arrival, angle_deg)
        return math.hypot(aside_m, off_m) if aside_m <= self.reach_m and off_m <= DEEP_M else math.inf

    def covered_by(self, arrival: Arrival, *, angle_deg: float) -> bool:
        """Whether another source's arrival lies in the image blocks where this one is looked up."""
        return max(self._away_m(arrival, angle_deg)) <= COVERED_M

    def with_part(self, other: Source) -> Source | None:
        """The spot that holds both, nearly at one position and strongest at about the same angle; else None."""
        # The absorbers of a stained spot outshine one another from angle to angle.
        if not self.same_position(other) or abs(other.angle_deg - self.angle_deg) > SPOT_DEG:
            return None
        return replace(self, reach_m=max(self.reach_m, abs(other.lateral_m - self.lateral_m) + NEAR_M))

    def same_position(self, other: Source) -> bool:
        """Whether two sources are near enough to be one spot."""
        return abs(self.lateral_m - other.lateral_m) <= SPOT_M and abs(self.depth_m - other.depth_m) <= DEEP_M

    def moveout_m(self, angle_deg: float) -> float:
        """Most by which the source may seem deeper at this angle of the probe, in metres (4)."""
        turned = math.radians(min(abs(angle_deg - self.angle_deg) + UNKNOWN_DEG, 180.0))
        radius_m = LARGEST_FACE_RADIUS_M + self.depth_m
        square_m2 = LARGEST_FACE_RADIUS_M**2 + radius_m**2 - 2 * LARGEST_FACE_RADIUS_M * radius_m * math.cos(turned)
        return math.sqrt(square_m2) - self.depth_m

    def _away_m(self, arrival: Arrival, angle_deg: float) -> tuple[float, float]:
        """Distance of an arrival along the array and in depth, moveout apart, in metres."""
        deeper_m = arrival.depth_m - self.depth_m
        off_m = max(-deeper_m, deeper_m - self.moveout_m(angle_deg), 0.0)
        return abs(arrival.lateral_m - self.lateral_m), off_m


def sources_of(lit: Sequence[Sample], *, level: float) -> tuple[Source, ...]:
    """Return the sources of all samples, the one with the strongest arrival first.

    ``level``: largest intensity that noise reaches anywhere in an image; weaker arrivals are not joined.
    """
    arrived = [
        (arrival, sample.angle_deg)
        for sample in lit
        for arrival in _separate(sample.reading)
        if arrival.intensity > level
    ]
    found: list[Source] = []
    for arrival, angle_deg in sorted(arrived, key=lambda row: -row[0].intensity):
        if any(math.isfinite(each.distance_m(arrival, angle_deg=angle_deg)) for each in found):
            continue
        source = Source(
            lateral_m=arrival.lateral_m,
            depth_m=arrival.depth_m,
            angle_deg=angle_deg,
            intensity=arrival.intensity,
        )
        for index, each in enumerate(found):
            spot = each.with_part(source)
            if spot is not None:
                found[index] = spot
                break
        else:
            found.append(source)
    return tuple(found)


def samples_at(lit: Sequence[Sample], sources: Sequence[Source], source: Source) -> tuple[list[Sample], list[Sample]]:
    """Return the samples as they are at the place of one source, and those that say only how loud it is at most.

    The former hold its strongest arrival, or the image at its place. The latter (`as_upper_limit`) are samples in which
    another source covers the place, and readings with nothing but their largest peak, which is elsewhere.

    ``sources``: an arrival is of the nearest.
    """
    own: list[Sample] = []
    bounds: list[Sample] = []
    for sample in lit:
        at, known = _sample_at(sample, sources, source)
        (own if known else bounds).append(at)
    return own, bounds


def _sample_at(sample: Sample, sources: Sequence[Source], source: Source) -> tuple[Sample, bool]:
    """A sample at the place of a source, and whether it is more than an upper limit."""
    reading, angle_deg = sample.reading, sample.angle_deg
    here: list[Arrival] = []
    elsewhere: list[Arrival] = []
    for arrival in _arrivals(reading):
        nearest = min(sources, key=lambda each: each.distance_m(arrival, angle_deg=angle_deg))
        mine = nearest is source and math.isfinite(source.distance_m(arrival, angle_deg=angle_deg))
        (here if mine else elsewhere).append(arrival)
    if here:
        arrival = max(here, key=lambda each: each.intensity)
        return replace(sample, reading=_of_arrival(reading, arrival, source, angle_deg=angle_deg), frame=None), True
    looked_up = None
    if reading.local_maxima is not None:
        looked_up = reading.local_maxima.near(
            lateral_m=source.lateral_m,
            low_depth_m=source.depth_m - NEAR_M,
            high_depth_m=source.depth_m + NEAR_M + source.moveout_m(angle_deg),
            within_m=NEAR_M,
        )
    if looked_up is None:
        return as_upper_limit(sample), False
    intensity, cells = looked_up
    looked_at = _without_position(sample, intensity=intensity, noise_sigma=reading.noise_sigma, cells=cells)
    if any(source.covered_by(arrival, angle_deg=angle_deg) for arrival in elsewhere):
        return as_upper_limit(looked_at), False
    return looked_at, True


def as_upper_limit(sample: Sample) -> Sample:
    """Return the sample as an upper limit: the source is no stronger, and another source may cause all of it.

    Another source acts as noise whose largest cell has that intensity (3).
    """
    reading = sample.reading
    cells = max(2, reading.cells or FEWEST_CELLS)
    noise_sigma = reading.intensity / math.sqrt(2 * math.log(cells))
    if reading.noise_sigma is not None:
        noise_sigma = max(reading.noise_sigma, noise_sigma)
    return _without_position(sample, intensity=reading.intensity, noise_sigma=noise_sigma, cells=cells)


def _without_position(sample: Sample, *, intensity: float, noise_sigma: float | None, cells: int) -> Sample:
    """A sample of this intensity without a position in the image."""
    reading = replace(
        sample.reading,
        intensity=intensity,
        noise_sigma=noise_sigma,
        cells=cells,
        lateral_m=None,
        depth_m=None,
        arrival_s=None,
        centroid_s=None,
        spread_s=None,
        coherence=None,
        focused_coherence=None,
        spot=None,
    )
    return replace(sample, reading=reading, frame=None)


def _arrivals(reading: Reading) -> Iterator[Arrival]:
    """Arrivals of a reading, and its largest peak where that is not coherent enough to be one."""
    yield from reading.arrivals
    if reading.lateral_m is None or reading.depth_m is None:
        return
    if not any(arrival.intensity >= reading.intensity for arrival in reading.arrivals):
        # Sound that is focused with a wrong speed, or with few elements, is not: `why_not_detected` tests it.
        yield Arrival(
            lateral_m=reading.lateral_m,
            depth_m=reading.depth_m,
            arrival_s=0.0 if reading.arrival_s is None else reading.arrival_s,
            intensity=reading.intensity,
            coherence=0.0 if reading.coherence is None else reading.coherence,
        )


def _separate(reading: Reading) -> Iterator[Arrival]:
    """Arrivals of a reading that no stronger one is near: beside a strong one lie its side lobes and its echoes."""
    kept: list[Arrival] = []
    for arrival in sorted(_arrivals(reading), key=lambda each: -each.intensity):
        away_m = [(abs(arrival.lateral_m - each.lateral_m), abs(arrival.depth_m - each.depth_m)) for each in kept]
        if all(aside > SPOT_M or deeper > DEEP_M for aside, deeper in away_m):
            yield arrival
        kept.append(arrival)


def _of_arrival(reading: Reading, arrival: Arrival, source: Source, *, angle_deg: float) -> Reading:
    """A reading whose peak is this arrival of a source."""
    if reading.local_maxima is None:
        return reading
    around = reading.local_maxima.near(
        lateral_m=source.lateral_m,
        low_depth_m=source.depth_m - DEEP_M,
        high_depth_m=source.depth_m + DEEP_M + source.moveout_m(angle_deg),
        within_m=source.reach_m,
    )
    largest = arrival.intensity >= reading.intensity
    return replace(
        reading,
        intensity=arrival.intensity,
        cells=reading.cells if around is None else around[1],
        lateral_m=arrival.lateral_m,
        depth_m=arrival.depth_m,
        arrival_s=arrival.arrival_s,
        # The moments, the focus and the energy are those of the largest peak of the image.
        centroid_s=reading.centroid_s if largest else None,
        spread_s=reading.spread_s if largest else None,
        coherence=arrival.coherence,
        focused_coherence=reading.focused_coherence if largest else None,
        spot=reading.spot if largest else None,
    )
