"""The sources of a search: arrivals joined by their place in the image, each with its samples and its posterior.

A frame holds up to eight arrivals, and a source is at one place in all of them: at the same lateral position, and at a
depth that grows off the plane by c·D(t) of (4) at most. A second marker, clutter, and a repeat of the sound behind a
source are therefore sources of their own. Where a source has no arrival in a frame, the image at its place still says
how strong it can be: the largest envelope of a few cells, not of a hundred thousand, so that M of (3) is small there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from msgspec import structs

from markerseek.core import Arrival, Float64, Interval, OtherSource, Reading, Sample
from markerseek.search.background import FLAT_SHARE
from markerseek.search.evidence import KNOWN_SIGMA_DEG
from markerseek.search.floor import FEWEST_CELLS, SearchNoise, noise_factor
from markerseek.search.posterior.angle_posterior import AnglePosterior

POINT_M = 1.5e-3
"""Largest distance between arrivals of one point along the array, in metres."""

SPOT_M = 3e-3
SPOT_DEG = 5.0
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
    reach_m: float = POINT_M
    """Largest distance of its other arrivals along the array."""

    def distance_m(self, arrival: Arrival, *, angle_deg: float) -> float:
        """Return the distance of an arrival at this angle of the probe, moveout apart, in metres.

        Infinite if it is too far.
        """
        aside_m, off_m = self._away_m(arrival, angle_deg)
        return math.hypot(aside_m, off_m) if aside_m <= self.reach_m and off_m <= DEEP_M else math.inf

    def covered_by(self, arrival: Arrival, *, angle_deg: float) -> bool:
        """Return whether another source's arrival lies in the image blocks where this one is looked up."""
        return max(self._away_m(arrival, angle_deg)) <= COVERED_M

    def with_part(self, other: Source) -> Source | None:
        """Return the spot that holds both, nearly at one position and strongest at about the same angle; else None."""
        # The absorbers of a stained spot outshine one another from angle to angle.
        if not self.same_position(other) or abs(other.angle_deg - self.angle_deg) > SPOT_DEG:
            return None
        return replace(self, reach_m=max(self.reach_m, abs(other.lateral_m - self.lateral_m) + NEAR_M))

    def same_position(self, other: Source) -> bool:
        """Return whether two sources are near enough to be one spot."""
        return abs(self.lateral_m - other.lateral_m) <= SPOT_M and abs(self.depth_m - other.depth_m) <= DEEP_M

    def moveout_m(self, angle_deg: float) -> float:
        """Return the most by which the source may seem deeper at this angle of the probe, in metres (4)."""
        turned = math.radians(min(abs(angle_deg - self.angle_deg) + UNKNOWN_DEG, 180.0))
        radius_m = LARGEST_FACE_RADIUS_M + self.depth_m
        square_m2 = LARGEST_FACE_RADIUS_M**2 + radius_m**2 - 2 * LARGEST_FACE_RADIUS_M * radius_m * math.cos(turned)
        return math.sqrt(square_m2) - self.depth_m

    def _away_m(self, arrival: Arrival, angle_deg: float) -> tuple[float, float]:
        """Return the distance of an arrival along the array and in depth, moveout apart, in metres."""
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
    """Return the samples as they are at the place of one source, and those that say only how strong it is at most.

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
    """Return a sample at the place of a source, and whether it is more than an upper limit."""
    reading = sample.reading
    angle_deg = sample.angle_deg
    here: list[Arrival] = []
    elsewhere: list[Arrival] = []
    for arrival in _arrivals(reading):
        nearest = min(sources, key=lambda each: each.distance_m(arrival, angle_deg=angle_deg))
        mine = nearest is source and math.isfinite(source.distance_m(arrival, angle_deg=angle_deg))
        (here if mine else elsewhere).append(arrival)
    if here:
        arrival = max(here, key=lambda each: each.intensity)
        return structs.replace(
            sample, reading=_of_arrival(reading, arrival, source, angle_deg=angle_deg), frame=None
        ), True
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
    """Return a sample of this intensity without a position in the image."""
    reading = structs.replace(
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
    return structs.replace(sample, reading=reading, frame=None)


def _arrivals(reading: Reading) -> Iterator[Arrival]:
    """Yield the arrivals of a reading, and its largest peak where that is not coherent enough to be one."""
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
    """Yield the arrivals without a stronger one near: beside a strong one lie its side lobes and echoes."""
    kept: list[Arrival] = []
    for arrival in sorted(_arrivals(reading), key=lambda each: -each.intensity):
        away_m = [(abs(arrival.lateral_m - each.lateral_m), abs(arrival.depth_m - each.depth_m)) for each in kept]
        if all(aside > SPOT_M or deeper > DEEP_M for aside, deeper in away_m):
            yield arrival
        kept.append(arrival)


def _of_arrival(reading: Reading, arrival: Arrival, source: Source, *, angle_deg: float) -> Reading:
    """Return a reading whose peak is this arrival of a source."""
    if reading.local_maxima is None:
        return reading
    around = reading.local_maxima.near(
        lateral_m=source.lateral_m,
        low_depth_m=source.depth_m - DEEP_M,
        high_depth_m=source.depth_m + DEEP_M + source.moveout_m(angle_deg),
        within_m=source.reach_m,
    )
    largest = arrival.intensity >= reading.intensity
    return structs.replace(
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


RIVAL_DB = 6.0
"""A source that is weaker by no more than this may be the marker as well, in dB."""


BESIDE_DEG = 1.0
"""Distance at which the narrowest curve still has half of its height, in degrees."""

KNOWN_LOG_SIGMA = 0.25
"""Standard deviation of ln A from which the strength of a source is known, 2 dB: a third of `RIVAL_DB`."""


SUSPECT_SHARE = 0.05
"""Share of searches in which noise alone has a peak that is looked at again."""

PLACE_SHARE = 0.01
"""Probability with which noise at the place of a source passes for it in one frame, when it is looked at again."""


_Side: TypeAlias = tuple[str, ...]
"""Samples of one source: all at a place, or those on the side of each dip that is named, "low" or "high"."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SourceSamples:
    """Samples of one source."""

    source: Source | None
    """None if the samples have no positions: then all of them are of one source."""
    side: _Side = ()
    """Which of several peaks at that place it is; empty if there is one."""
    samples: Sequence[Sample]
    """The samples with the laser on, as they are at its place."""
    bounds: Sequence[Sample] = ()
    """Samples that say only how strong it is at most (`as_upper_limit`)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate(SourceSamples):
    """A source with its posterior."""

    missing: str | None
    """Why they are no evidence of a source; None if they are."""
    posterior: AnglePosterior
    seen: int
    """Number of samples in which it exceeds the noise."""
    measured: bool
    """Whether a sample was taken at its angle, or at the end of the range beyond which it lies."""
    beyond: bool = False
    """Whether it lies beyond an end of the range."""
    log_most: float = math.inf
    """Ln of the most that its intensity over σ can be by what was measured at its angle; infinite where nothing was."""

    @property
    def log_snr_sigma(self) -> float:
        """Standard deviation of ln of the intensity over σ."""
        return float(np.std(self.posterior.log_snr))

    @property
    def strength_known(self) -> bool:
        """Whether it was measured at its angle, and so often that its strength is known, as far as it can be."""
        vague = self.log_snr_sigma > KNOWN_LOG_SIGMA
        vague = vague or float(np.mean(self.posterior.log_snr)) > self.log_most
        return self.measured and (self.beyond or not vague)

    @property
    def known(self) -> bool:
        """Whether its strength is known, and its angle."""
        return self.strength_known and self.posterior.centre_sigma_deg <= KNOWN_SIGMA_DEG

    @property
    def log_snr(self) -> float:
        """Ln of the intensity with the probe on it, over σ."""
        return min(float(np.mean(self.posterior.log_snr)), self.log_most)

    @property
    def has_positions(self) -> bool:
        """Whether its samples have positions in the image."""
        return all(sample.reading.local_maxima is not None for sample in self.samples)

    @property
    def interval95_deg(self) -> Interval:
        """Interval that holds its angle with 95 % probability."""
        return Interval(low_deg=self.posterior.quantile_deg(0.025), high_deg=self.posterior.quantile_deg(0.975))

    def apart_from(self, other: Candidate) -> bool:
        """Return whether the 95 % intervals of two sources are separate."""
        mine = self.interval95_deg
        theirs = other.interval95_deg
        return mine.high_deg < theirs.low_deg or theirs.high_deg < mine.low_deg

    def relative_db(self, other: Candidate) -> float:
        """Return the strength over that of another source, in dB."""
        return 20 / math.log(10) * (self.log_snr - other.log_snr)

    def stronger_probability(self, other: Candidate) -> float:
        """Return the probability that it is stronger than another, from the standard deviations of both."""
        spread = math.hypot(self.log_snr_sigma, other.log_snr_sigma)
        return 0.5 * math.erfc((other.log_snr - self.log_snr) / (math.sqrt(2) * max(spread, 1e-9)))

    def as_other_source(self, other: Candidate) -> OtherSource:
        """Return the source as an answer names it beside another."""
        place = self.source
        return OtherSource(
            angle_deg=self.posterior.mean_deg,
            sigma_deg=self.posterior.sigma_deg,
            relative_db=self.relative_db(other),
            lateral_m=None if place is None else place.lateral_m,
            depth_m=None if place is None else place.depth_m,
        )


def suspect_level(lit: Sequence[Sample], noise: SearchNoise) -> float:
    """Return the intensity above which the largest peak of a frame is measured again, because it may be another source.

    It is lower than the detection threshold, which proves a source: noise has such a peak in one search of twenty,
    which takes one acquisition more. 0 where the threshold is unknown.
    """
    level = noise.level_or_zero
    cells = [sample.reading.cells for sample in lit if sample.reading.local_maxima is not None]
    if noise.sigma is None or len(cells) < len(lit) or None in cells:
        return level
    most = max(each for each in cells if each is not None)
    return min(level, noise.sigma * noise_factor(cells=most, frames=len(lit), false_found=SUSPECT_SHARE))


def times_seen(at: Sequence[Sample], noise: SearchNoise) -> int:
    """Return the number of samples in which a source exceeds the noise.

    A place has fewer cells than an image, and less noise.
    """
    level = noise.level_or_zero
    sigma = noise.sigma or math.inf
    levels = [
        level
        if sample.reading.local_maxima is None or sample.reading.cells is None
        else min(level, sigma * noise_factor(cells=sample.reading.cells, frames=1, false_found=PLACE_SHARE))
        for sample in at
    ]
    return sum(sample.reading.intensity > each for sample, each in zip(at, levels, strict=True))


def is_burst(own: Sequence[Sample], bounds: Sequence[Sample], place: Source, noise: SearchNoise) -> bool:
    """Return whether a source was strong at one angle and not beside it, where even the narrowest curve would be."""
    # An upper bound says the same as a sample where it is below the detection threshold.
    measured = [*own, *(bound for bound in bounds if bound.reading.intensity <= noise.level_or_zero)]
    beside = sum(abs(sample.angle_deg - place.angle_deg) <= BESIDE_DEG for sample in measured)
    # Far away noise passes for it in one frame of a hundred, and a sweep has hundreds.
    near = [sample for sample in own if abs(sample.angle_deg - place.angle_deg) <= SPOT_DEG]
    return beside > 1 and times_seen(near, noise) <= 1


def is_background(at: Sequence[Sample]) -> bool:
    """Return whether a place is equally strong at all angles, as an artefact of the rig is."""
    intensities = [sample.reading.intensity for sample in at]
    return len(at) > 1 and max(intensities) - min(intensities) <= FLAT_SHARE * max(intensities)


OUTLIER_RATIO = 3.0
"""An intensity over the largest of those beside it from which it is an outlier: the narrowest curve changes by 2."""


def outliers_of(lit: Sequence[Sample], *, level: float) -> list[Sample]:
    """Return the samples that no curve explains, because each is far stronger than all samples beside it.

    Of samples that have places in the image none: there a burst is no source (`is_burst`). Of a sample without others
    within `ALIKE_DEG` it is not known. ``level``: the detection threshold, which an outlier exceeds.
    """
    if any(sample.reading.local_maxima is not None or sample.sweep is not None for sample in lit):
        return []
    angle_deg = np.array([sample.angle_deg for sample in lit])
    height = np.array([sample.reading.intensity for sample in lit])
    near = np.abs(angle_deg[:, None] - angle_deg) <= ALIKE_DEG
    np.fill_diagonal(near, False)
    strongest_beside = np.where(near, height, 0.0).max(axis=1, initial=0.0)
    far = near.any(axis=1) & (height > level) & (height > OUTLIER_RATIO * np.maximum(strongest_beside, level))
    return [sample for sample, out in zip(lit, far, strict=True) if out]


DIP_SIGMAS = 3.0
DOUBTFUL_DIP_SIGMAS = 2.0
"""Standard deviations of noise and laser by which a dip must lie below both peaks, and for doubt."""

SAMPLE_ERROR = 0.03
PULSE_ERROR = 0.12
"""Relative error of one sample by itself, the laser's energy: at rest, and of a single pulse of a sweep."""

MIN_DIP = 0.1
NEAR_FIELD_DIP = 0.35
"""Least depth of a dip over the lower peak, for intensities alone, and for frames, where the near field is excluded."""

ALIKE_DEG = 1.0
"""Samples nearer than this are alike on any curve: a burst or a misfire among them is neither peak nor dip."""

PEAKS_APART_DEG = 5.0
"""Least distance of two peaks, in degrees: nearer ones are absorbers of one stained spot, which interfere."""

ASYMMETRY_SHARE = 0.2
"""Least share of a sample's intensity by which one nearer to the centre must be weaker, on either side, for doubt."""

TOP_SHARES = (-0.35, 0.0, 0.35)
"""Angles about the answer, over the full width at half maximum, at which a dip would show."""

TOP_REACH = 0.25
"""Distance from such an angle, over the same width, at which a sample serves as well."""


def dip_deg(at: Sequence[Sample], *, sigma: float, level: float, single: bool = False) -> float | None:
    """Return the angle of the deepest dip between two peaks, in degrees; None without one.

    ``sigma``: noise of one intensity, in its unit. ``level``: largest intensity that noise reaches; both peaks must be
    above it. ``single``: whether intensities alone need a dip as deep as frames do.
    """
    if len(at) < 3:
        return None
    order = sorted(at, key=lambda sample: sample.angle_deg)
    angle_deg = np.array([sample.angle_deg for sample in order])
    height, error = _heights(order)
    top, bottom = _without_bursts(angle_deg, height)
    has_positions = all(sample.reading.local_maxima is not None for sample in at)
    lower = np.minimum(np.maximum.accumulate(top)[:-2], np.maximum.accumulate(top[::-1])[::-1][2:])
    drop = lower - bottom[1:-1]
    least = np.maximum(
        DIP_SIGMAS * np.hypot(1.5 * sigma, error[1:-1] * lower),
        (NEAR_FIELD_DIP if has_positions or single else MIN_DIP) * lower,
    )
    # Distance of the two peaks around each sample.
    inner = np.arange(1, len(order) - 1)
    apart_deg = np.array(
        [angle_deg[k + 1 + np.argmax(top[k + 1 :])] - angle_deg[np.argmax(top[:k])] for k in inner.tolist()]
    )
    # An angle measured twice lies between no others where it is the first or the last: the marker has moved.
    between = (angle_deg[1:-1] > angle_deg[0]) & (angle_deg[1:-1] < angle_deg[-1])
    deep = np.where((drop > least) & (lower > level) & (apart_deg >= PEAKS_APART_DEG) & between, drop, 0.0)
    return float(angle_deg[1:-1][np.argmax(deep)]) if deep.any() else None


def _heights(order: Sequence[Sample]) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Return the intensities and relative errors.

    Of a pulse it is the median of those about it, because one of hundreds may be weak.
    """
    height = np.array([sample.reading.intensity for sample in order])
    angle_deg = np.array([sample.angle_deg for sample in order])
    sweep = np.array([0 if sample.sweep is None else sample.sweep.number for sample in order])
    alike = (np.abs(angle_deg[:, None] - angle_deg) <= ALIKE_DEG / 2) & (sweep[:, None] == sweep)
    error = np.where(sweep > 0, PULSE_ERROR / np.sqrt(alike.sum(axis=1)), SAMPLE_ERROR)
    return np.array([np.median(height[alike[k]]) if sweep[k] else height[k] for k in range(len(order))]), error


def _without_bursts(
    angle_deg: Float64[np.ndarray, " samples"], height: Float64[np.ndarray, " samples"]
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Return the intensities for peaks and for dips, so that a burst makes no peak and a misfire no dip."""
    near = np.abs(angle_deg[:, None] - angle_deg) <= ALIKE_DEG
    np.fill_diagonal(near, False)
    top = height.copy()
    bottom = height.copy()
    for k in np.flatnonzero(near.any(axis=1)).tolist():
        # Within a degree no curve changes by more than to a half.
        top[k] = min(height[k], 2.0 * height[near[k]].max())
        bottom[k] = max(height[k], 0.5 * height[near[k]].min())
    return top, bottom


def top_deg(posterior: AnglePosterior, measured_deg: Sequence[float]) -> float | None:
    """Return an angle in the top of the curve where a dip may still hide; None where samples would have shown it.

    ``measured_deg``: angles measured so far.
    """
    for share in TOP_SHARES:
        angle_deg = posterior.mean_deg + share * posterior.fwhm_deg
        apart = min((abs(angle_deg - each) for each in measured_deg), default=math.inf)
        if apart > TOP_REACH * posterior.fwhm_deg:
            return angle_deg
    return None


def asymmetric_sample(at: Sequence[Sample], *, centre_deg: float, sigma: float, level: float) -> Sample | None:
    """Return the sample that is stronger than one nearer to the centre, by the largest difference; None without one.

    A curve that is symmetric and falls from its centre has none: the sample is of another curve.
    """
    order = sorted(at, key=lambda sample: abs(sample.angle_deg - centre_deg))
    angle_deg = np.array([sample.angle_deg for sample in order])
    height, error = _heights(order)
    top, bottom = _without_bursts(angle_deg, height)
    drop = top - np.minimum.accumulate(bottom)
    least = np.maximum(DOUBTFUL_DIP_SIGMAS * np.hypot(1.5 * sigma, error * top), ASYMMETRY_SHARE * top)
    excess = np.where((drop > least) & (top > level), drop, 0.0)
    return order[int(np.argmax(excess))] if excess.any() else None


def gap_angle_deg(angle_deg: float, measured_deg: Sequence[float]) -> float | None:
    """Return the middle of the wider gap beside a measured angle, in degrees; None where both are narrow."""
    gaps = []
    for side in (-1.0, 1.0):
        away = min((side * (each - angle_deg) for each in measured_deg if side * (each - angle_deg) > 0), default=0.0)
        gaps.append((away, angle_deg + side * away / 2))
    widest, middle_deg = max(gaps)
    return middle_deg if widest > 2 * ALIKE_DEG else None
